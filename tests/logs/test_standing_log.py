"""Logs of a standing robot, perhaps of one sample, for the method `static`."""

import json

import numpy as np
import pytest
from foreign_logs import write_csv

from equipoise import BayesianMethod, RunFolder, load_robot, nominal_stance, simulate
from equipoise.cli import main
from equipoise.errors import RecordingError
from equipoise.lab.static.method import Static
from equipoise.logs.offline import estimate_standing_log
from equipoise.logs.reader import read_log
from equipoise.platform.platform import JointCommand
from equipoise.robot.inertial import components, nominal_inertia
from equipoise.robot.kinematics import inverse_kinematics_best_effort
from equipoise.robot.statics import static_torques

UNITREE = ("FR", "FL", "RR", "RL")


@pytest.fixture(scope="module")
def a1():
    return load_robot("unitree_a1")


def standing(robot, seed):
    """A sample of a simulated robot that stands, and its true body."""
    with simulate(robot, "realistic", "1.2,0.06,0.02,0.08", seed=seed) as simulation:
        command = JointCommand(position=np.array(nominal_stance(robot).joint_position))
        for _ in range(round(0.5 / simulation.platform.control_period)):
            state = simulation.platform.step(command)
        return state, components(simulation.truth.composite)


def write_message(path, robot, state):
    """A message as Unitree's Python SDK prints it, as JSON: 20 motors, of which 12 are there."""
    order = [robot.joint_names.index(joint) for leg in UNITREE for joint in robot.legs[leg].joint_names]
    motors = [{"q": state.joint_position[at], "dq": 0.0, "tau_est": state.joint_torque[at]} for at in order]
    none = {"q": 0.0, "dq": 0.0, "tau_est": 0.0}
    path.write_text(json.dumps({"motor_state": [*motors, *8 * [none]]}) + "\n", encoding="utf-8")
    return path


def columns_of(robot, state):
    quantities = {"position": state.joint_position, "torque": state.joint_torque}
    return {f"{kind}.{name}": of[[at]] for kind, of in quantities.items() for at, name in enumerate(robot.joint_names)}


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_intervals_of_one_sample_contain_the_truth(a1, tmp_path, seed):
    state, truth = standing(a1, seed)
    log = read_log(write_csv(tmp_path / "one.csv", columns_of(a1, state)), a1, standing=True)
    result = estimate_standing_log(a1, log, Static()).result
    mass, x, y, *unknown = result.composite
    for quantity, true in zip((mass, x, y), truth, strict=False):
        assert quantity.lower < true < quantity.upper, quantity.name
    assert all(quantity.value is None and quantity.std is None for quantity in unknown)
    assert abs(mass.value / truth[0] - 1) < 0.1
    assert 0.15 < mass.std / mass.value < 0.25  # the motors' torque constant dominates
    assert x.std < 10e-3 > y.std
    assert any("torque gain 20%" in assumption for assumption in result.assumptions)


def test_a_message_of_unitree_is_read_by_the_command(a1, tmp_path, capsys):
    state, truth = standing(a1, 1)
    path = write_message(tmp_path / "message.jsonl", a1, state)
    arguments = ["estimate", str(path), "--robot", "unitree_a1", "--method", "static"]
    assert main([*arguments, "--json"]) == 5
    proposal = json.loads(capsys.readouterr().out)["error"]["columns"]
    assert 'torque.FR_hip_joint = "motor_state[0].tau_est"' in proposal
    (tmp_path / "columns.toml").write_text(proposal, encoding="utf-8")
    out = tmp_path / "found.json"
    assert main([*arguments, "--columns", str(tmp_path / "columns.toml"), "--out", str(out)]) == 0
    assert "method static" in capsys.readouterr().out
    found = json.loads(out.read_text(encoding="utf-8"))["composite"]
    assert found["mass"] == pytest.approx(truth[0], rel=0.1)


@pytest.mark.parametrize("lean", [(0.15, 0.0), (0.0, -0.12)])
def test_a_leaning_robot_has_the_centre_of_mass_of_an_upright_one(a1, tmp_path, lean):
    stance, (roll, pitch) = nominal_stance(a1), lean
    turned = np.array([[1, 0, -pitch], [0, 1, roll], [pitch, -roll, 1]]) / np.sqrt(1 + roll**2 + pitch**2)
    position = inverse_kinematics_best_effort(a1, stance.feet_in_base @ turned, np.array(stance.joint_position))
    joints = {"position": position, "torque": static_torques(a1, position, ("FL", "FR", "RL", "RR"))}
    table = {f"{kind}.{name}": of[[at]] for kind, of in joints.items() for at, name in enumerate(a1.joint_names)}
    log = read_log(write_csv(tmp_path / "leaning.csv", table), a1, standing=True)
    found = estimate_standing_log(a1, log, Static()).result.composite.values
    expected = components(nominal_inertia(a1, stance.joint_position).composite)
    assert found[0] == pytest.approx(expected[0], rel=0.01)
    assert found[1:3] == pytest.approx(expected[1:3], abs=0.5e-3)


def test_a_log_that_cannot_be_used_is_refused_with_the_remedy(a1, tmp_path):
    state, _ = standing(a1, 1)
    table = columns_of(a1, state)
    without = {name: column for name, column in table.items() if not name.startswith("torque")}
    with pytest.raises(RecordingError, match=r"has no torque\.JOINT"):
        read_log(write_csv(tmp_path / "without.csv", without), a1, standing=True)
    lying = {name: column * (0 if name.startswith("torque") else 1) + 1e-3 for name, column in table.items()}
    with pytest.raises(RecordingError, match="the robot lies or hangs"):
        estimate_standing_log(a1, read_log(write_csv(tmp_path / "lying.csv", lying), a1, standing=True), Static())
    moving = {name: np.concatenate([column, column + 0.1, column]) for name, column in table.items()}
    path = write_csv(tmp_path / "moving.csv", {"time": np.arange(3.0), **moving})
    with pytest.raises(RecordingError, match=r"moves by 0\.10 rad.*--from and --until"):
        estimate_standing_log(a1, read_log(path, a1, standing=True), Static())
    assert estimate_standing_log(
        a1, read_log(path, a1, standing=True, span=(1.5, None)), Static()
    ).result.composite.mass.value


def test_static_is_for_logs_and_not_for_runs(a1, tmp_path, capsys):
    with RunFolder.create(tmp_path / "run", a1, BayesianMethod(), {}):
        assert main(["estimate", str(tmp_path / "run"), "--method", "static"]) == 2
    assert (
        "--method static is for logs of other programs; the method of this run is bayesian" in capsys.readouterr().err
    )
