"""A platform of one's own: anything with these methods and properties can be calibrated.

python examples/06_custom_platform.py
"""

from equipoise import calibrate, load_robot, simulate
from equipoise.lab.static.method import Static


class CountingPlatform:
    """Counts the commands to a simulated robot; yours talks to a robot."""

    def __init__(self, inner):
        self.inner, self.commands, self.longest = inner, 0, 0.0
        self.control_period, self.joint_names, self.accepts = inner.control_period, inner.joint_names, inner.accepts

    def read(self):
        return self.inner.read()

    def step(self, command):
        self.commands += 1
        return self.inner.step(command)

    def play(self, trajectory, stop=None):
        self.commands += len(trajectory.position)
        self.longest = max(self.longest, len(trajectory.position) * self.control_period)
        return self.inner.play(trajectory, stop)

    def close(self):
        self.inner.close()


robot = load_robot("unitree_a1")
with simulate(robot, preset="realistic", seed=1) as simulation:
    platform = CountingPlatform(simulation.platform)
    result = calibrate(platform, robot, Static())
mass = result.composite.mass.value
print(f"{platform.commands} commands, {platform.longest:.1f} s at most at once; about {mass:.1f} kg")
