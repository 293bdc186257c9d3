"""Baselines of motor identification recover the motors of a simulated leg, so that the comparison is valid."""

import pickle
import sys
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from equipoise import nominal_stance

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))  # last: some names equal those of tests

from baselines_of_others import go2_log, motors, mujoco_sysid, mujoco_sysid_motors, torque_regression, trajectory_fit
from baselines_of_others.held_base import HeldBase, JointParameters, Swing

TIMESTEP = 1e-3  # [s]


@pytest.fixture(scope="module")
def scale(a1):
    return nominal_stance(a1).scale


@pytest.fixture(scope="module")
def truth():
    """Motors with different parameters."""
    spread = np.linspace(0.8, 1.2, 12)
    gain = np.ones(12)
    return JointParameters(0.01 * spread, 0.06 * spread[::-1], 0.3 * spread, 0.004 * (spread - 1), gain, 5e-3)


@pytest.fixture(scope="module")
def swing(a1, truth):
    """Noise-free motion of an A1's legs for two seconds, with commands held for 2 ms."""
    sent, start = 0.002 * np.arange(1, 1100), nominal_stance(a1).joint_position
    phases = np.arange(12)
    rates = 2 * np.pi * np.array([1.1, 2.9, 5.3])
    sines = np.sin(rates * sent[:, None, None] + phases[:, None]) - np.sin(phases)[:, None]
    target = start + 0.5 * np.clip(sent / 0.2, 0, 1)[:, None] * (sines * [0.2, 0.12, 0.08]).sum(axis=2)
    time = sent[10:1010]
    bare = Swing(time, np.zeros((1000, 12)), None, start, sent, target, 25.0, 0.8, np.array([0.3, -0.2, -9.8]))
    world = HeldBase(a1, bare, TIMESTEP)
    control = world.control(truth.delay)
    target = np.vstack([control, control[-1:]])
    position, torque = np.split(
        world.sampled(world.encoders_and_torques(truth, world.states([truth])[0], target)), 2, axis=1
    )
    return replace(bare, position=position, torque=torque)


def off(found, truth, name):
    """Return the largest error over all joints relative to the truth."""
    return np.abs(getattr(found, name) / getattr(truth, name) - 1).max()


def test_a_trajectory_fit_recovers_motors_from_commands_and_encoders(a1, scale, swing, truth):
    blind = replace(swing, torque=None)
    short = replace(blind, time=swing.time[:400], position=swing.position[:400])
    found = trajectory_fit.fit(a1, short, scale, timestep=2 * TIMESTEP)
    assert max(off(found, truth, name) for name in ("armature", "viscous_friction", "coulomb_friction")) < 0.06
    assert found.delay == pytest.approx(truth.delay + TIMESTEP / 2, abs=0.1e-3)  # of the longer step: held_base.py


def test_a_torque_regression_recovers_motors_from_exact_torques(a1, scale, swing, truth):
    found = torque_regression.fit(a1, swing, scale)
    assert off(found, truth, "coulomb_friction") < 0.05
    assert off(found, truth, "viscous_friction") < 0.25
    assert off(found, truth, "armature") < 0.25


def test_mujoco_sysid_recovers_motors_if_it_is_installed(a1, scale, swing, truth):
    if mujoco_sysid.toolbox() is None:
        pytest.skip("mujoco.sysid is not installed")
    short = replace(swing, time=swing.time[:300], position=swing.position[:300], torque=swing.torque[:300])
    found = mujoco_sysid_motors.fit(a1, short, scale)
    assert max(off(found, truth, name) for name in ("armature", "viscous_friction", "coulomb_friction")) < 0.06


def test_errors_are_those_of_our_table(truth):
    exact = [
        {"coulomb_friction": c, "viscous_friction": v, "armature": a, "relative_gain": 0.0, "delay": 5e-3}
        for c, v, a in zip(truth.coulomb_friction, truth.viscous_friction, truth.armature, strict=True)
    ]

    def errors_of(found):
        return motors.errors_of(motors.values_of(found, ("relative_gain", "delay")), exact)

    assert all(max(map(abs, errors)) < 1e-9 for errors in errors_of(truth).values())
    wrong = replace(truth, delay=6e-3, coulomb_friction=1.1 * truth.coulomb_friction, gain=np.linspace(0.9, 1.1, 12))
    errors = errors_of(wrong)
    assert errors["delay"] == pytest.approx([1.0] * 12)
    assert errors["coulomb_friction"] == pytest.approx([10.0] * 12)
    assert errors["relative_gain"][0] == pytest.approx(-10.0)


def test_reading_a_torch_file_executes_no_code(tmp_path):
    def file(data):
        with zipfile.ZipFile(tmp_path / "log.pt", "w") as archive:
            archive.writestr("log/data.pkl", data)
            archive.writestr("log/data/0", np.arange(6, dtype="<f4").tobytes())
        return tmp_path / "log.pt"

    tensor = (
        b"(dS'q'\nctorch._utils\n_rebuild_tensor_v2\n((S'storage'\nctorch\nFloatStorage\nS'0'\nS'cpu'\nI6\ntQ"
        b"I1\n(I2\nI2\nt(I2\nI1\ntI00\nNtRs."
    )
    assert go2_log.read_tensors(file(tensor))["q"].tolist() == [[1, 2], [3, 4]]
    with pytest.raises(pickle.UnpicklingError, match=r"os\.system is neither a tensor"):
        go2_log.read_tensors(file(b"cos\nsystem\n(S'true'\ntR."))
