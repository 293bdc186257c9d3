"""From a robot's own file to a first result: what speaks against the file, what would be done, and a first look.

    python examples/02_your_robot.py [ROBOT.urdf [ROBOT_TIME_IN_SECONDS]]

The description says what the file leaves out; from a TOML file it comes with RobotDescription.from_toml("robot.toml").
"""

import sys
from pathlib import Path

from equipoise import BayesianMethod, RobotDescription, audit, calibrate, load_robot, nominal_stance, simulate
from equipoise.lab.static.method import Static
from equipoise.robot.catalog import CATALOG

file = Path(sys.argv[1]) if len(sys.argv) > 1 else CATALOG["unitree_a1"].find()
method = BayesianMethod(duration=float(sys.argv[2]) if len(sys.argv) > 2 else None)

robot = load_robot(file, RobotDescription(stance_height=0.72, imu_position=(0.0, 0.0, 0.05)))
print(f"{robot.name}: {robot.mass:.2f} kg, base link {robot.base_link}, feet {', '.join(robot.legs)}")
for finding in audit(robot).findings:
    print(f"  {finding}")

plan = method.forecast(robot, nominal_stance(robot))
worst = 1000 * plan.std[1:4].max()
print(f"{plan.lifts} lifts in {plan.robot_time:.0f} s would tell the CoM to {worst:.1f} mm (1 sd)")

# In simulation first. Static only stands and reads the torques; pass `method` to do the plan.
with simulate(robot, preset="realistic", seed=1) as simulation:
    result = calibrate(simulation.platform, robot, Static())
mass, com = result.composite.mass, result.composite.com_in_base
print(f"at first sight: {mass.value:.1f} kg, CoM at {1000 * com.x.value:.0f}, {1000 * com.y.value:.0f} mm")
