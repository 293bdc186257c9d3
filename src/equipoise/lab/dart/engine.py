"""Entry point of `simulate(robot, engine="dart")` for DART, a physics engine of Gazebo."""

from __future__ import annotations

from equipoise.errors import MissingDependencyError, SettingsError
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance
from equipoise.simulation.drawn_errors import DrawnErrors
from equipoise.simulation.effects import Contacts
from equipoise.simulation.payload import Payload
from equipoise.simulation.simulated import Start
from equipoise.simulation.simulation import Simulation


def build(
    robot: RobotModel,
    stance: Stance,
    errors: DrawnErrors,
    payload: Payload | None,
    start: Start,
    timestep: float | None,
    contacts: Contacts,
) -> Simulation:
    """Return a simulated robot in DART; arguments are those of `equipoise.simulation.simulation.build`.

    Raises:
        MissingDependencyError: DART is not installed.
        SettingsError: the contact model is only available in MuJoCo.
    """
    if contacts != "default":
        raise SettingsError("dart cannot take contacts from the model file; omit --contact-model, or use mujoco")
    try:
        import dartpy  # noqa: PLC0415

        from equipoise.lab.dart.dart_model import build_dart_robot  # noqa: PLC0415
        from equipoise.lab.dart.dart_platform import DartPlatform  # noqa: PLC0415
        from equipoise.lab.dart.dart_truth import dart_truth, ground_truth_of  # noqa: PLC0415
    except ModuleNotFoundError as error:
        raise MissingDependencyError("simulation in DART needs dartpy: pip install 'equipoise[dart]'") from error
    simulated = build_dart_robot(robot, stance, errors, payload, timestep)
    truth = dart_truth(robot, simulated, stance.joint_position)
    platform = DartPlatform(robot, simulated, stance, start)
    return Simulation(platform, truth, dartpy.__version__, errors, ground_truth_of(simulated))
