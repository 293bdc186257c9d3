"""Presets of effects on the command line: enabled, disabled and refused effects."""

import json
from types import SimpleNamespace

import pytest

from equipoise.cli import main
from equipoise.cli.target import RunTarget, SimulatedTarget

QUIET = ["--quiet", "--no-report"]


def test_a_run_keeps_its_effects(tmp_path):
    out = tmp_path / "run"
    world = [
        "--sim-preset",
        "stress",
        "--disable-effect",
        "springs,backlash",
        "--disable-effect",
        "cable",
        "--enable-effect",
        "swinging_load,jitter=1e-3",
    ]
    assert main(["calibrate", "--method", "static", *world, *QUIET, "--out", str(out)]) == 0
    facts = json.loads((out / "calibration.json").read_text(encoding="utf-8"))["provenance"]
    assert facts["sim_preset"] == "stress"
    assert facts["effects"] == {"swinging_load": None, "jitter": 1e-3}
    place = RunTarget.of(SimpleNamespace(path=out, provenance=facts))
    assert place.disable_effect == ("springs", "backlash", "cable")
    assert place.facts() == {name: facts[name] for name in place.facts()}
    assert place.world.startswith(
        "preset stress, with swinging_load, with jitter 0.001, without springs, without backlash"
    )


def test_the_provenance_of_a_default_run_has_no_effects():
    facts = SimulatedTarget("mujoco").facts()
    assert set(facts) == {
        "platform", "sim_preset", "payload", "seed", "start", "noise_seed", "contact_model", "effects", "disabled_effects",
    }  # fmt: skip
    assert (facts["effects"], facts["disabled_effects"], facts["contact_model"]) == ({}, [], "default")


@pytest.mark.parametrize("verb", ["calibrate", "lab monte-carlo", "lab balance"])
@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (["--disable-effect", "sprngs"], "'sprngs' is not an effect of a simulated robot"),
        (["--enable-effect", "cable=much"], "'cable=much' does not give cable a size"),
        (["--enable-effect", "cable", "--disable-effect", "cable"], "both enabled and disabled"),
        (["--enable-effect", "cable=-1"], "cable is -1.0; it must be"),
    ],
)
def test_invalid_effects_are_refused_by_name(verb, flags, words, tmp_path, capsys):
    assert main([*verb.split(), *flags, "--quiet", "--out", str(tmp_path / "out")]) == 2
    assert words in capsys.readouterr().err


def test_effects_that_an_engine_lacks_raise(tmp_path, capsys):
    pytest.importorskip("dartpy")
    flags = ["--platform", "dart", "--enable-effect", "springs", "--quiet", "--out", str(tmp_path / "out")]
    assert main(["calibrate", *flags]) == 2
    assert "dart does not support the effects springs; disable them" in capsys.readouterr().err


def test_balancing_tolerates_lost_samples(tmp_path):
    flags = ["--sim-preset", "ideal", "--enable-effect", "lost_samples=0.02", "--duration", "1s", "--diagonal", "FL_RR"]
    assert (
        main(["lab", "balance", *flags, "--com-error=0mm", "--check", "--quiet", "--no-report", "--out", str(tmp_path)])
        == 0
    )
