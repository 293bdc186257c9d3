"""`doctor --hanging` against the emulator of a Go2, whose boards damp after 0.1 s without a command."""

import io
import json
import sys

import pytest
from emulator_processes import running_emulator, unused_domain

pytest.importorskip("cyclonedds")

from equipoise import nominal_stance
from equipoise.cli import main
from equipoise.drivers import motor_boards

pytestmark = pytest.mark.realtime
DOCTOR = ["doctor", "unitree_a1", "--platform", "unitree-go2", "--hanging"]


def test_a_hanging_robot_is_damped_and_left_alone_in_turn(monkeypatch, capsys, a1):
    monkeypatch.setattr(sys, "stdin", io.StringIO("unitree_a1\n"))
    monkeypatch.setattr(motor_boards, "_SILENCES", (0.1, 1.5))
    monkeypatch.setattr(motor_boards, "_AS_FOUND", 0.5)
    domain = unused_domain()
    with running_emulator("unitree-dds", "--domain", domain, "--sim-preset", "ideal") as peer:
        for number in range(30):  # hops, so that its legs move
            peer.fault(push=[0, 0, 2 * 9.81 * a1.mass], after=0.4 * number, **{"for": 0.12})
        code = main([*DOCTOR, "--set", "interface=lo", "--set", f"domain={domain}", "--json"])
        log = peer.end()
    printed = capsys.readouterr()
    assert code == 0, printed.err
    assert "The robot must hang" in printed.err
    phases = json.loads(printed.out)["phases"]
    assert [phase["name"] for phase in phases] == [
        "as found", "damped", "silent for 0.1 s", "damped", "silent for 1.5 s", "damped",
    ]  # fmt: skip
    boards = a1.gains(nominal_stance(a1).hip_height)[1]
    commanded, silent = phases[3], phases[4]
    assert commanded["commanded_damping"] == pytest.approx(0.2 * 5.0)
    assert commanded["damping"] == pytest.approx(1.0, rel=0.15)
    assert silent["commanded_damping"] is None
    assert silent["damping"] == pytest.approx(boards, rel=0.15)
    for phase in phases:
        assert (phase["motor_modes"], phase["lost"], phase["rejected"], phase["temperature"]) == ([1], 0, 0, 40.0)
        assert phase["samples"] > 100 * phase["duration"]
    modes = {entry["mode"] for entry in log if "mode" in entry}
    assert modes <= {"own stance", "released", "damped", "silence"}  # never stiff
    assert {"damped", "silence", "released"} <= modes


def test_a_table_is_printed_and_garbage_is_counted(monkeypatch, capsys):
    monkeypatch.setattr(sys, "stdin", io.StringIO("unitree_a1\n"))
    monkeypatch.setattr(motor_boards, "_SILENCES", (0.1,))
    monkeypatch.setattr(motor_boards, "_AS_FOUND", 0.5)
    monkeypatch.setattr(motor_boards, "_DAMPED", 1.0)
    domain = unused_domain()
    with running_emulator("unitree-dds", "--domain", domain, "--sim-preset", "ideal", "--no-sport-mode") as peer:
        peer.fault(damage=0.5)
        assert main([*DOCTOR, "--set", "interface=lo", "--set", f"domain={domain}"]) == 0
    rows = [line.split() for line in capsys.readouterr().out.splitlines() if line.strip().startswith("damped")]
    assert len(rows) == 2
    assert int(rows[0][-4]) > 100  # rejected


@pytest.mark.parametrize(
    ("flags", "typed", "message"),
    [
        (DOCTOR, "no\n", "not confirmed, no command was sent; type unitree_a1 to confirm"),
        (["doctor", "--hanging"], "unitree_a1\n", "'mujoco' has no driver; --hanging needs a real robot"),
    ],
)
def test_nothing_is_sent_unless_the_robot_is_named_and_real(monkeypatch, capsys, flags, typed, message):
    monkeypatch.setattr(sys, "stdin", io.StringIO(typed))
    assert main([*flags, *(["--set", "interface=lo"] if "--platform" in flags else [])]) == 2
    assert message in " ".join(capsys.readouterr().err.split())
