"""Draws of a Monte Carlo study: reproducible by trial number, with independent random streams."""

import dataclasses
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from robots import quadruped_urdf

from equipoise import ComSearchSettings, PaperMethod
from equipoise.errors import EquipoiseError, ModelError, SettingsError
from equipoise.lab.static.method import Static
from equipoise.lab.study.study import SOURCES, Study, draw
from equipoise.lab.study.trial import check_study
from equipoise.robot.description import RobotDescription
from equipoise.simulation.effects import REALISTIC, EffectSizes

VARIED = Study(vary_effects=True, seed=5)
SHOWN = f"""
import json, sys
sys.path[:0] = {[str(Path(__file__).parents[above]) for above in (0, 2)]}
from equipoise.lab.study.study import Study, draw
from test_study import VARIED, shown
"""


def shown(drawn):
    """Return a draw as numbers for exact comparison."""
    payload = drawn.payload.parameters
    return [
        payload.mass, payload.com.tolist(), payload.inertia.tolist(), dataclasses.astuple(drawn.sizes), drawn.seed,
    ]  # fmt: skip


def json_form(value):
    return json.loads(json.dumps(value))


def test_a_trial_number_gives_the_same_robot_in_any_order_and_in_another_process():
    forward = {trial: shown(draw(VARIED, trial)) for trial in range(4)}
    backward = {trial: shown(draw(VARIED, trial)) for trial in reversed(range(4))}
    assert forward == backward
    code = SHOWN + "print(json.dumps([shown(draw(VARIED, trial)) for trial in (2, 0)]))"
    other = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert json.loads(other.stdout) == json_form([forward[2], forward[0]])


def test_other_numbers_and_other_seeds_give_other_robots():
    draws = [shown(draw(VARIED, trial)) for trial in range(5)]
    draws += [shown(draw(dataclasses.replace(VARIED, seed=6), trial)) for trial in range(5)]
    for place in range(len(draws[0])):
        assert len({json.dumps(entry[place]) for entry in draws}) == len(draws)


@pytest.mark.parametrize(
    ("change", "kept"),
    [
        ({"payload": "none"}, ("sizes", "seed")),
        ({"vary_effects": False}, ("payload", "seed")),
        ({"only": ("joint_offset",)}, ("payload", "seed")),
        ({"methods": (Static(),)}, ("payload", "sizes", "seed")),
    ],
)
def test_disabling_one_draw_does_not_change_the_others(change, kept):
    for trial in range(3):
        one, other = draw(VARIED, trial), draw(dataclasses.replace(VARIED, **change), trial)
        views = {
            "payload": lambda drawn: drawn.payload.parameters.com.tolist(),
            "sizes": lambda drawn: drawn.sizes,
            "seed": lambda drawn: drawn.seed,
        }
        for name in kept:
            assert views[name](one) == views[name](other)


@pytest.mark.parametrize("noise", ["realistic", "stress"])
def test_varied_sizes_range_from_zero_to_twice_the_default(noise):
    usual = draw(Study(preset=noise), 0).sizes
    drawn = [draw(Study(preset=noise, vary_effects=True), trial).sizes for trial in range(60)]
    for row in EffectSizes.rows():
        size = getattr(usual, row.name)
        if not row.varied or size == row.none:
            assert {getattr(sizes, row.name) for sizes in drawn} == {size}
            continue
        ratios = np.array([row.amount(getattr(sizes, row.name)) for sizes in drawn]) / row.amount(size)
        assert (ratios >= 0).all()
        assert (ratios <= 2).all()
        assert ratios.min() < 0.3
        assert ratios.max() > 1.7
        assert np.unique(ratios).size == len(drawn)


def test_draws_of_the_first_sources_do_not_change_with_new_effects():
    drawn = draw(VARIED, 3)
    assert (drawn.sizes.joint_offset, drawn.sizes.floor_slope) == (0.00843092179016249, 0.00403770334773202)
    assert drawn.seed == 3447195048259697815


def test_an_additional_effect_does_not_change_other_factors():
    more, less = (
        draw(Study(preset="stress", disabled_effects=w, vary_effects=True, seed=2), 1).sizes
        for w in ((), ("backlash",))
    )
    assert dataclasses.replace(more, backlash=0.0) == less
    assert more.backlash


def test_a_study_has_effects_in_addition_to_a_preset(a1):
    sizes = draw(Study(effects={"springs": 3000.0, "cable": None}, disabled_effects=("joint_offset",)), 0).sizes
    assert (sizes.springs, sizes.cable, sizes.joint_offset) == (3000.0, 0.15, 0.0)


@pytest.mark.parametrize("vary_effects", [False, True])
def test_only_the_named_sources_are_kept(vary_effects):
    sizes = draw(Study(only=("joint_offset", "imu_tilt"), vary_effects=vary_effects), 3).sizes
    assert {name for name in SOURCES if getattr(sizes, name)} == {"joint_offset", "imu_tilt"}


def test_the_clock_of_the_imu_stays_within_the_delay():
    alone = draw(Study(only=("imu_clock_offset", "sensor_delay")), 0).sizes
    assert (alone.imu_clock_offset, alone.sensor_delay) == (REALISTIC.imu_clock_offset, REALISTIC.sensor_delay)
    with pytest.raises(SettingsError, match="add sensor_delay to"):
        Study(only=("imu_clock_offset",))


def test_random_payloads_weigh_5_to_30_percent_of_the_base(a1):
    base = float(a1.pinocchio.inertias[1].mass)
    payloads = [draw(Study(), trial).payload.parameters for trial in range(80)]
    shares = np.array([payload.mass for payload in payloads]) / base
    assert (shares >= 0.05).all()
    assert (shares <= 0.30).all()
    assert np.ptp(shares) > 0.2
    places = np.array([payload.com for payload in payloads])
    assert (np.abs(places[:, :2]) <= [0.13, 0.055]).all()
    assert (places[:, 2] > 0.02).all()


def test_payload_is_as_given_or_none():
    payload = draw(Study(payload="1.5,0.1,0,0.08"), 7).payload.parameters
    assert (payload.mass, payload.com.tolist()) == (1.5, [0.1, 0.0, 0.08])
    assert draw(Study(payload="none"), 7).payload is None


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"methods": ()}, ["bayesian, paper, motors"]),
        ({"methods": (Static(), Static())}, ["static, static", "once"]),
        ({"preset": "loud"}, ["'loud'", "ideal, realistic, stress"]),
        ({"effects": {"wind": None}}, ["'wind'", "not an effect", "joint_offset"]),
        ({"disabled_effects": ("sprngs",)}, ["'sprngs'", "did you mean 'springs'"]),
        ({"only": ("gremlins",)}, ["'gremlins'", "joint_offset"]),
        ({"only": ("floor_friction",)}, ["'floor_friction'", "floor_slope"]),
        ({"payload": "heavy"}, ["'heavy'", "MASS,X,Y,Z"]),
        ({"payload": "-1,0,0,0"}, ["-1", "positive"]),
        ({"seed": -1}, ["-1", "zero or more"]),
        ({"timestep": 0.0}, ["0 s", "positive"]),
        ({"timestep": float("nan")}, ["nan", "positive"]),
    ],
)
def test_errors_of_settings_name_value_and_fix(settings, words):
    with pytest.raises(SettingsError) as caught:
        Study(**settings)
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize(
    ("settings", "error", "words"),
    [
        ({"robot": "rex"}, ModelError, "no robot is called 'rex'"),
        ({"robot": "no/such.urdf"}, ModelError, "does not exist"),
        (
            {"methods": (PaperMethod(com_search=ComSearchSettings(tolerance=0.9)),)},
            SettingsError,
            "leaves nothing to search",
        ),
        ({"timestep": 0.0003}, SettingsError, "whole multiple of it"),
        ({"timestep": 0.002}, SettingsError, "contacts of the feet need"),
        ({"description": RobotDescription(stance_height=0.99)}, EquipoiseError, "stance"),
    ],
)
def test_an_error_of_every_trial_is_raised_first(settings, error, words):
    with pytest.raises(error, match=words):
        check_study(Study(**settings))


def test_fingerprints_distinguish_studies_and_contents_of_model_files(tmp_path):
    assert Study().fingerprint == Study().fingerprint
    methods = ({"methods": (Static(),)}, {"methods": (PaperMethod(feet="commanded"),)})
    others = ({"effects": {"cable": 0.1}}, {"disabled_effects": ("cable",)}, {"contact_model": "file"})
    for change in (*others, {"seed": 1}, {"robot": "go1"}, *methods, {"timestep": 1e-3}):
        assert Study(**change).fingerprint != Study().fingerprint
    file = tmp_path / "robot.urdf"
    file.write_text(quadruped_urdf(), encoding="utf-8")
    before = Study(str(file)).fingerprint
    assert Study(str(file)).fingerprint == before
    file.write_text(quadruped_urdf(trunk_mass=7), encoding="utf-8")
    assert Study(str(file)).fingerprint != before
