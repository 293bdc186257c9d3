"""Estimate from a log that another program wrote: here a CSV file, made on the spot from a run's recordings.

    python examples/04_from_a_log.py [RUN_FOLDER]

Columns are those of docs/logs.md. In the file nothing says what the robot was doing: lifts and moves are found in it.
"""

import csv
import sys
from pathlib import Path

import numpy as np

from equipoise import BayesianMethod, RunFolder, calibrate, load_robot, simulate
from equipoise.logs.offline import estimate_log
from equipoise.logs.reader import read_log

if len(sys.argv) > 1:
    run = RunFolder.open(sys.argv[1])
    robot, recordings = run.robot(), run.recordings()
else:
    robot, recordings = load_robot("unitree_a1"), []
    with simulate(robot, preset="realistic", seed=3) as simulation:
        calibrate(simulation.platform, robot, keep=recordings.append)

file = Path(f"{robot.name}_log.csv")
with file.open("w", newline="") as stream:
    writer = csv.writer(stream)
    signals = [f"{signal}.{joint}" for signal in ("position", "velocity", "torque") for joint in robot.joint_names]
    writer.writerow(["time", *signals, *(f"{sensor}.{axis}" for sensor in ("gyro", "accelerometer") for axis in "xyz")])
    for one in recordings:
        joints, imu = one.joints, one.imu  # sampled together in simulation
        columns = joints.time, joints.position, joints.velocity, joints.torque
        rows = np.column_stack([*columns, imu.angular_velocity_in_imu, imu.acceleration_in_imu])
        writer.writerows(rows.tolist())
found = estimate_log(robot, read_log(file, robot), BayesianMethod())
print(f"{sum(trial.kind == 'lift' for trial in found.result.trials)} lifts found in {file}")
for one in found.result.composite:
    print(f"{one.name:5} {one.lower:8.4f} to {one.upper:8.4f}  {one.verdict}")
