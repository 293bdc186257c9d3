"""Platform of another package, with a simulated robot."""

from equipoise import JointCommand, RobotModel, RobotState, SteppedPlatform, simulate


class Robot(SteppedPlatform):
    """Robot that is moved step by step."""

    def __init__(self, robot: RobotModel, *, preset: str = "ideal", seed: int = 0) -> None:
        super().__init__(robot)
        self._there = simulate(robot, preset, seed=seed).platform
        self.control_period = self._there.control_period

    def read(self) -> RobotState:
        return self._there.read()

    def step(self, command: JointCommand) -> RobotState:
        return self._there.step(command)

    def close(self) -> None:
        self._there.close()
