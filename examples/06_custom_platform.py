"""A platform of one's own: anything with these methods and properties can be calibrated.

    python examples/06_custom_platform.py

This one stands between the routine and a simulated robot and counts what passes. Yours would talk to a robot in `read` and `step`.
"""

from equipoise import CalibrationSettings, JointCommand, Recording, RobotState, Trajectory, calibrate, load_robot, simulate
from equipoise.platforms.platform import TiltLimit, play_by_stepping


class CountingPlatform:
    """Passes everything on; `play` may always be done by steps."""

    def __init__(self, inner) -> None:
        self.inner, self.commands, self.torque = inner, 0, 0.0
        self.control_period, self.joint_names, self.accepts = inner.control_period, inner.joint_names, inner.accepts

    def read(self) -> RobotState:
        return self.inner.read()

    def step(self, command: JointCommand) -> RobotState:
        state = self.inner.step(command)
        self.commands += 1
        self.torque = max(self.torque, abs(state.joint_torque).max())
        return state

    def play(self, trajectory: Trajectory, stop: TiltLimit | None = None) -> Recording:
        return play_by_stepping(self, trajectory, stop)

    def close(self) -> None:
        self.inner.close()


robot = load_robot("unitree_a1")
with simulate(robot, noise="realistic", seed=1) as simulation:
    platform = CountingPlatform(simulation.platform)
    result = calibrate(platform, robot, CalibrationSettings("static"))
print(f"{platform.commands} commands, at most {platform.torque:.1f} Nm; the robot weighs about {result.composite.mass:.1f} kg")
