"""The log of a simulated robot that trots, as a table with the columns of docs/logs.md.

    python examples/07_walking_log.py [SECONDS]
    equipoise estimate a1_trot.csv --robot unitree_a1 --mass 13.6

Nothing in it says what the robot did: its steps are found in it.
"""

import csv
import sys

import numpy as np

from equipoise import load_robot, simulate
from equipoise.lab.gaits.trot import trot

robot = load_robot("unitree_a1")
with simulate(robot, preset="realistic", payload="1.2,0.06,0.02,0.08", seed=7) as simulation:
    log = trot(simulation.platform, robot, float(sys.argv[1]) if len(sys.argv) > 1 else 21.0)
    truth = simulation.truth.composite

with open("a1_trot.csv", "w", newline="") as stream:
    writer = csv.writer(stream)
    signals = [f"{signal}.{joint}" for signal in ("position", "velocity", "torque") for joint in robot.joint_names]
    writer.writerow(["time", *signals, *(f"{sensor}.{axis}" for sensor in ("gyro", "accelerometer") for axis in "xyz")])
    joints, imu = log.joints, log.imu  # sampled together in simulation
    of_joints = joints.position, joints.velocity, joints.torque
    writer.writerows(
        np.column_stack([joints.time, *of_joints, imu.angular_velocity_in_imu, imu.acceleration_in_imu]).tolist()
    )

x, y, z = 1000 * truth.com
print(
    f"a1_trot.csv: {len(joints.time)} samples. What it should tell: {truth.mass:.2f} kg, CoM {x:.1f} {y:.1f} {z:.1f} mm"
)
