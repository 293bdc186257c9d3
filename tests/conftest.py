"""Fixtures that many tests share."""

import gc
import signal
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from browser import why_no_browser
from hypothesis import settings
from real_time import pytest_runtest_protocol, repeated  # noqa: F401  the first is a hook of pytest
from robots import load_text, quadruped_urdf

import equipoise
from equipoise import BayesianMethod, PaperMethod, calibrate, load_robot, nominal_stance, simulate
from equipoise.bayesian.lift_design import LiftDesign
from equipoise.bayesian.trials import BayesianTrials
from equipoise.experiments.stand import stand_up
from equipoise.guard import remote_robot
from equipoise.robot.description import RobotDescription
from equipoise.robot.inertial import composite_parameters
from equipoise.robot.posture import BodyPosture
from equipoise.simulation import mujoco_model
from equipoise.user_cache import VARIABLE

# No deadlines, because a loaded machine is slow at times; derandomized, so that a commit always passes or always fails.
settings.register_profile("equipoise", deadline=None, derandomize=True)
settings.load_profile("equipoise")


def pytest_collection_finish():
    """Exclude modules and collected tests from garbage collection: they live to the end, and it would visit them."""
    gc.collect()
    gc.freeze()


def pytest_terminal_summary(terminalreporter):
    """List tests that were not tried, which would look like passed ones."""
    reason = why_no_browser()
    if reason is not None:
        terminalreporter.write_line(f"WARNING: {reason}", yellow=True)
    if names := repeated(terminalreporter):
        terminalreporter.write_line(f"Repeated, because the machine stalled in a failed try: {', '.join(names)}")
    skipped = (str(report.longrepr[2]) for report in terminalreporter.getreports("skipped") if report.longrepr)
    for reason in dict.fromkeys(reason for reason in skipped if "NOT TRIED" in reason):
        print(f"WARNING: {reason.removeprefix('Skipped: ')}", file=sys.stderr)


@pytest.fixture(scope="session", autouse=True)
def default_signals():
    """Restore the default reaction to signals, also in the processes that tests start.

    A shell's background jobs ignore Ctrl-C, `nohup` ignores a terminal that closes, and both are inherited.
    """
    defaults = {
        signal.SIGINT: signal.default_int_handler,
        signal.SIGTERM: signal.SIG_DFL,
        signal.SIGHUP: signal.SIG_DFL,
    }
    before = {number: signal.signal(number, handler) for number, handler in defaults.items()}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.fixture(scope="session")
def shared_folder(request, tmp_path_factory):
    """Return a folder that all workers of this run of the tests share."""
    own = tmp_path_factory.getbasetemp()
    return own.parent if hasattr(request.config, "workerinput") else own


@pytest.fixture(scope="session", autouse=True)
def cache(shared_folder):
    """Replace the user's cache by a new one for this run of the tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(VARIABLE, str(shared_folder / "cache"))
        yield


@pytest.fixture(autouse=True)
def _robot_process_in_real_time_only(request, monkeypatch):
    """Fail a test that starts a robot process without the mark `realtime`: other tests delay it beyond its limits."""

    def refuse(*_, **__):
        pytest.fail(f"{request.node.name} starts a robot process; mark it with pytest.mark.realtime")

    if request.node.get_closest_marker("realtime") is None:
        monkeypatch.setattr(remote_robot.RemoteRobot, "__init__", refuse)


USUAL_TIMESTEP = mujoco_model.TIMESTEP


@pytest.fixture(scope="session", autouse=True)
def coarse_engine():
    """Let MuJoCo take steps of 1 ms, which halves the computation of its physics."""
    yield from _steps_of(1e-3)


@pytest.fixture(scope="module")
def fine_engine():
    """Let MuJoCo take its usual steps, in tests whose figures depend on them."""
    yield from _steps_of(USUAL_TIMESTEP)


def _steps_of(timestep):
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(mujoco_model, "TIMESTEP", timestep)
        yield


@pytest.fixture(scope="session")
def a1():
    """Return the built-in Unitree A1."""
    return load_robot("unitree_a1")


@pytest.fixture(scope="session")
def a1_urdf():
    """Return the text of the built-in A1's URDF."""
    return (Path(equipoise.__file__).parent / "robot" / "models" / "a1.urdf").read_text(encoding="utf-8")


@pytest.fixture(scope="session")
def skewed(tmp_path_factory):
    """Return a robot without symmetry: three joints per leg, in another order than the legs, an arm, and a tilted IMU."""
    order = {"RR": "a", "FL": "b", "RL": "c", "FR": "d"}
    text = quadruped_urdf(arm_joints=2, joint_name=lambda leg, joint: f"{order[leg]}_{joint}")
    imu = RobotDescription(imu_position=(0.05, -0.03, 0.04), imu_rpy=(0.4, -0.3, 1.2))
    return load_text(tmp_path_factory.mktemp("skewed"), text, imu)


@pytest.fixture(scope="session")
def two_jointed(tmp_path_factory):
    """Return a robot without abduction, as Solo8; its CoM is not in the middle of its feet."""
    return load_text(tmp_path_factory.mktemp("two_jointed"), quadruped_urdf(joints_per_leg=2))


@pytest.fixture(scope="session")
def ideal_motions(a1):
    """Return a move of an ideal simulated A1 into a tilted posture, and a lift trial in it with the body rotating."""
    stance = nominal_stance(a1)
    com = composite_parameters(a1, stance.joint_position).com
    posture = BodyPosture(roll=0.15, yaw=0.2, crouch=0.1)
    with simulate(a1, "ideal") as simulation:
        standing, _ = stand_up(simulation.platform, a1, stance)
        trials = BayesianTrials(standing, stance, com)
        return SimpleNamespace(
            stance=stance,
            posture=posture,
            move=trials.take_posture(posture),
            lift=trials.lift(LiftDesign(posture, "FL_RR", 1, "roll")),
        )


@pytest.fixture(scope="session")
def bayesian_run(a1):
    """Return a short Bayesian run of a realistic A1 with a payload: settings, recordings, result and truth."""
    recordings = []
    settings = BayesianMethod(duration=60, excitation=False)
    with simulate(a1, "realistic", seed=4, payload="1.5,0.05,-0.02,0.06") as simulation:
        result = calibrate(simulation.platform, a1, settings, keep=recordings.append)
        return SimpleNamespace(
            stance=nominal_stance(a1),
            settings=settings,
            recordings=recordings,
            result=result,
            truth=simulation.truth,
            seed=4,
        )


@pytest.fixture(scope="session")
def paper_run(a1):
    """Return a run of the paper's method on an ideal A1: recordings, and the result with the truth."""
    recordings = []
    with simulate(a1, "ideal") as simulation:
        result = calibrate(simulation.platform, a1, PaperMethod(), keep=recordings.append).with_truth(simulation.truth)
    return SimpleNamespace(recordings=recordings, result=result)


@pytest.fixture(scope="session")
def paper_result(paper_run):
    """Return the result of `paper_run`."""
    return paper_run.result
