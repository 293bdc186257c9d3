"""Reader of logs in NumPy archives with their own names."""

from pathlib import Path

import numpy as np

from equipoise import RawImu, RawJoints, RawLog, RobotModel, Topics


def read_arrays(path: Path, robot: RobotModel, topics: Topics) -> RawLog:
    """Read the arrays time, names, position, torque, gyro, accelerometer."""
    log = np.load(path)
    joints = RawJoints(log["time"], tuple(map(str, log["names"])), log["position"], torque=log["torque"])
    return RawLog(joints, RawImu(log["time"], log["gyro"], log["accelerometer"]), about={"format": "arrays"})
