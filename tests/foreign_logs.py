"""Logs as others write them, made of recordings of ours: bags of both kinds, LowState, tables."""

import csv
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from equipoise import BayesianMethod
from equipoise.drivers.unitree.motors import MOTOR_LEGS
from equipoise.logs.joint_names import JointMap
from equipoise.logs.message_types import known_types
from equipoise.logs.offline import estimate_log
from equipoise.logs.raw_log import Log
from equipoise.recording.recording import Recording

LEGGED = {  # the parts that matter of what an A1 or a Go1 says by ROS 1, and another recorder's stamp
    "unitree_legged_msgs/msg/IMU": "float32[4] quaternion\nfloat32[3] gyroscope\nfloat32[3] accelerometer\nint8 temperature",
    "unitree_legged_msgs/msg/MotorState": "uint8 mode\nfloat32 q\nfloat32 dq\nfloat32 ddq\nfloat32 tauEst\nuint32[2] reserve",
    "unitree_legged_msgs/msg/LowState": (
        "uint8[2] head\nIMU imu\nMotorState[20] motorState\nint16[4] footForce\nuint32 tick\nuint32 crc"
    ),
    "unitree_legged_msgs/msg/HighState": "time stamp\nIMU imu\nMotorState[20] motorState\nfloat32 bodyHeight",
}
LEGGED_OF_OLD = {**LEGGED, "unitree_legged_msgs/msg/HighState": "uint8 levelFlag\nIMU imu\nfloat32 bodyHeight"}
EPOCH = 1_763_712_000_123_456_789  # [ns]


def as_log(recordings):
    """Consecutive recordings as one log, without their trials and events."""
    return replace(Recording.concatenate(recordings), events=())


def estimated(robot, walked, recording=None):
    """Estimate from the log of a simulated walk, or another one, with the robot's mass."""
    mass = walked.truth.mass
    log = Log(recording or walked.log, JointMap(()), {}, ())
    return estimate_log(robot, log, BayesianMethod(mass=mass, mass_std=0.005 * mass))


def every(stream, step, start=0):
    """A stream with every k-th sample."""
    names = [name for name in vars(stream) if getattr(stream, name) is not None]
    return replace(stream, **{name: getattr(stream, name)[start::step] for name in names})


def without(stream, start, end):
    """A stream with a hole from one time to another."""
    kept = (stream.time < start) | (stream.time > end)
    names = [name for name in vars(stream) if getattr(stream, name) is not None]
    return replace(stream, **{name: getattr(stream, name)[kept] for name in names})


def shifted(stream, seconds):
    return replace(stream, time=stream.time + seconds)


def store():
    types = get_typestore(Stores.EMPTY)
    types.register(dict(known_types()))
    return types


def nanoseconds(time):
    return (np.round(np.asarray(time) * 1e9).astype(np.int64) + EPOCH).tolist()


class Bag:
    """Writer of a bag; topics are added one after the other, messages sorted by receive time."""

    def __init__(self, path, storage="mcap"):
        """In a folder, of ROS 2; a storage "ros1" is a file of ROS 1."""
        self.path = path
        self.store = get_typestore(Stores.ROS1_NOETIC) if storage == "ros1" else store()
        self.plugin = {"mcap": StoragePlugin.MCAP, "sqlite3": StoragePlugin.SQLITE3, "ros1": None}[storage]
        self.serialize = self.store.serialize_cdr if self.plugin else self.store.serialize_ros1
        self.messages = []
        self.topics = {}

    def add(self, topic, message_type, received, messages):
        self.topics[topic] = message_type
        self.messages += [
            (time, topic, self.serialize(message, message_type))
            for time, message in zip(received, messages, strict=True)
        ]

    def write(self):
        if self.plugin is None:
            self.path = self.path.with_suffix(".bag")
            writing = Ros1Writer(self.path)
        else:
            writing = Writer(self.path, version=9, storage_plugin=self.plugin)
        with writing as writer:
            connections = {
                topic: writer.add_connection(topic, kind, typestore=self.store) for topic, kind in self.topics.items()
            }
            for time, topic, data in sorted(self.messages, key=lambda message: message[0]):
                writer.write(connections[topic], time, data)
        return self.path

    def header(self, stamp, frame=""):
        types = self.store.types
        time = types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
        sequence = {} if self.plugin else {"seq": 7}  # which ROS 1 has and ROS 2 has not
        return types["std_msgs/msg/Header"](**sequence, stamp=time, frame_id=frame)

    def joints(self, topic, names, stream, received=None, stamps=None):
        """A joint stream as JointState."""
        kind, none = "sensor_msgs/msg/JointState", np.zeros(0)
        message = self.store.types[kind]
        stamps = nanoseconds(stream.time) if stamps is None else stamps
        velocity = getattr(stream, "velocity", None)
        torque = getattr(stream, "torque", None)
        messages = [
            message(
                header=self.header(stamp),
                name=list(names),
                position=np.array(stream.position[k]),
                velocity=none if velocity is None else np.array(velocity[k]),
                effort=none if torque is None else np.array(torque[k]),
            )
            for k, stamp in enumerate(stamps)
        ]
        self.add(topic, kind, stamps if received is None else received, messages)
        return self

    def imu(self, topic, stream, received=None, stamps=None, frame="imu_link", quat_wxyz=None, known=True):
        """An IMU stream as Imu; with an orientation that is known, or is said not to be."""
        kind, types, unknown = "sensor_msgs/msg/Imu", self.store.types, np.zeros(9)
        vector, quaternion = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Quaternion"]
        stamps = nanoseconds(stream.time) if stamps is None else stamps
        quat_wxyz = [[1, 0, 0, 0]] * len(stamps) if quat_wxyz is None else quat_wxyz
        messages = [
            types[kind](
                header=self.header(stamp, frame),
                orientation=quaternion(**dict(zip("wxyz", map(float, quat_wxyz[k]), strict=True))),
                orientation_covariance=unknown if known else unknown - 1,
                angular_velocity=vector(*map(float, stream.angular_velocity_in_imu[k])),
                angular_velocity_covariance=unknown,
                linear_acceleration=vector(*map(float, stream.acceleration_in_imu[k])),
                linear_acceleration_covariance=unknown,
            )
            for k, stamp in enumerate(stamps)
        ]
        self.add(topic, kind, stamps if received is None else received, messages)
        return self

    def low_states(self, robot, log, received=None, ticks=True, topic="/lowstate", foot_force=None):
        """Joints and IMU as LowState: one message a joint sample. Foot forces are in the order of its motors' legs."""
        kind, types = "unitree_go/msg/LowState", self.store.types
        order = [robot.legs[leg].joints[place] for leg in MOTOR_LEGS for place in range(3)]
        joints, imu = log.joints, log.imu
        assert np.array_equal(joints.time, imu.time)
        torque = np.zeros_like(joints.position) if joints.torque is None else joints.torque
        stamps = nanoseconds(joints.time)
        foot_force = np.zeros((len(stamps), 4)) if foot_force is None else foot_force

        def motor(k, joint):
            q, dq, tau = (0.0, 0.0, 0.0) if joint is None else (
                float(joints.position[k, joint]), float(joints.velocity[k, joint]), float(torque[k, joint]))  # fmt: skip
            return types["unitree_go/msg/MotorState"](
                mode=1, q=q, dq=dq, ddq=0.0, tau_est=tau, q_raw=q, dq_raw=dq, ddq_raw=0.0, temperature=30, lost=0,
                reserve=np.zeros(2, np.uint32),
            )  # fmt: skip

        battery = types["unitree_go/msg/BmsState"](
            version_high=1, version_low=0, status=0, soc=80, current=-1000, cycle=3, bq_ntc=np.zeros(2, np.int8),
            mcu_ntc=np.zeros(2, np.int8), cell_vol=np.zeros(15, np.uint16),
        )  # fmt: skip
        messages = [
            types[kind](
                head=np.array([0xFE, 0xEF], np.uint8), level_flag=0xFF, frame_reserve=0, sn=np.zeros(2, np.uint32),
                version=np.zeros(2, np.uint32), bandwidth=0,
                imu_state=types["unitree_go/msg/IMUState"](
                    quaternion=np.array([1, 0, 0, 0], np.float32), gyroscope=imu.angular_velocity_in_imu[k].astype(np.float32),
                    accelerometer=imu.acceleration_in_imu[k].astype(np.float32), rpy=np.zeros(3, np.float32), temperature=40,
                ),
                motor_state=[motor(k, joint) for joint in [*order, *[None] * 8]],
                bms_state=battery, foot_force=foot_force[k].astype(np.int16), foot_force_est=np.zeros(4, np.int16),
                tick=(stamp - stamps[0]) // 10**6 + 1 if ticks else 0, wireless_remote=np.zeros(40, np.uint8),
                bit_flag=0, adc_reel=0.0, temperature_ntc1=0, temperature_ntc2=0, power_v=28.0, power_a=1.0,
                fan_frequency=np.zeros(4, np.uint16), reserve=0, crc=0,
            )
            for k, stamp in enumerate(stamps)
        ]  # fmt: skip
        self.add(topic, kind, stamps if received is None else received, messages)
        return self

    def legged_states(self, robot, log, kind="LowState", definitions=LEGGED, foot_force=None):
        """Joints and IMU as an A1 or a Go1 says them, in a bag of ROS 1; times of receipt are those of the samples."""
        self.store.register(
            {n: d for name, text in definitions.items() for n, d in get_types_from_msg(text, name).items()}
        )
        types, name = self.store.types, f"unitree_legged_msgs/msg/{kind}"
        motor, sensors = types["unitree_legged_msgs/msg/MotorState"], types["unitree_legged_msgs/msg/IMU"]
        order = [robot.legs[leg].joints[place] for leg in MOTOR_LEGS for place in range(3)]
        joints, imu, stamps = log.joints, log.imu, nanoseconds(log.joints.time)
        foot_force = np.zeros((len(stamps), 4)) if foot_force is None else foot_force
        spare = motor(mode=0, q=0.0, dq=0.0, ddq=0.0, tauEst=0.0, reserve=np.zeros(2, np.uint32))
        states = []
        for k, stamp in enumerate(stamps):
            q, dq, tau = joints.position[k], joints.velocity[k], joints.torque[k]
            parts = {
                "motorState": [
                    replace(spare, q=float(q[j]), dq=float(dq[j]), tauEst=float(tau[j])) for j in order
                ] + [spare] * 8,
                "imu": sensors(
                    quaternion=np.array([1, 0, 0, 0], np.float32), gyroscope=imu.angular_velocity_in_imu[k].astype(np.float32),
                    accelerometer=imu.acceleration_in_imu[k].astype(np.float32), temperature=40,
                ),
                "stamp": types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9),
                "footForce": foot_force[k].astype(np.int16),
                "head": np.zeros(2, np.uint8), "tick": 1 + 1000 * k, "crc": 0, "bodyHeight": 0.3, "levelFlag": 0,
            }  # fmt: skip
            state = types[name]
            states.append(state(**{part: parts[part] for part in state.__dataclass_fields__ if part in parts}))
        self.add(f"/{kind.lower()}", name, stamps, states)
        return self


def write_bag(path, log, storage="mcap", names=None, joints="/joint_states", imu="/imu/data"):
    """JointState and Imu, with stamps of one clock."""
    bag = Bag(path, storage).joints(joints, names or log.joint_names, log.joints).imu(imu, log.imu)
    return bag.write()


def columns_of(log, names=None):
    """A table's columns: joints and IMU in rows of their own where their times differ."""
    names = names or log.joint_names
    time = np.union1d(log.joints.time, log.imu.time)
    of_joints, of_imu = np.isin(time, log.joints.time), np.isin(time, log.imu.time)
    table = {"time": time}

    def put(name, rows, values):
        table[name] = np.full(len(time), np.nan)
        table[name][rows] = values

    for quantity in ("position", "velocity", "torque"):
        values = getattr(log.joints, quantity)
        if values is not None:
            for name, column in zip(names, values.T, strict=True):
                put(f"{quantity}.{name}", of_joints, column)
    for sensor, values in (("gyro", log.imu.angular_velocity_in_imu), ("accelerometer", log.imu.acceleration_in_imu)):
        for axis, column in zip("xyz", values.T, strict=True):
            put(f"{sensor}.{axis}", of_imu, column)
    return table


def write_csv(path, columns):
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        for row in zip(*columns.values(), strict=True):
            writer.writerow(["" if np.isnan(value) else repr(float(value)) for value in row])
    return path


def write_parquet(path, columns):
    pq.write_table(pa.table({name: pa.array(values, from_pandas=True) for name, values in columns.items()}), path)
    return path
