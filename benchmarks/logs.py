"""Estimates from logs without equipoise's events, of simulated and real robots: `make bench-logs`. Writes results/logs.md.

Robots with a payload walk in three engines, with the effects that these support. Their logs are written as tables and read
like those of other programs; a scale has an error of 0.5 % (rms). Others are logs of calibrations without events, at reduced
rates or without a sensor, and walks with the base's pose in place of an accelerometer. Logs of real robots: `real_logs.py`.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from rows import Case, Page, Row, Table, main  # isort: skip - it limits the threads of NumPy
import numpy as np
import real_logs
from scipy.spatial.transform import Rotation
from simulated import FIRST_SEED, SCALE_ERROR, cases_of, judged, robot_called, weighed
from tables import SILENT, column, coverage, figures, is_silent, markdown, relative, rms
from walks import GAITS, payload_on_trunk, write_table
from worlds.world import ENGINES, world

from equipoise import (
    BayesianMethod,
    Calibration,
    Payload,
    Recording,
    RobotModel,
    calibrate,
    nominal_stance,
    simulate,
)
from equipoise.errors import RecordingError
from equipoise.lab.replay.validation import validate
from equipoise.logs.offline import estimate_log
from equipoise.logs.raw_log import RawImu, RawJoints, RawLog, assemble
from equipoise.logs.reader import read_log
from equipoise.logs.tables.column_names import ColumnProposal, Columns
from equipoise.result.held_out import FOUND, MODEL
from equipoise.result.statistics import NORMAL_95
from equipoise.robot.inertial import COMPONENTS, InertialParameters

# Engine, preset, robot, gait, duration on an A1 [s]: number of seeds.
WALKS = {
    **{(engine, preset, "unitree_a1", "trot", 20): 8 for engine in ENGINES for preset in ("realistic", "stress")},
    **{(engine, "realistic", "go2", "trot", 20): 4 for engine in ENGINES},
    **{(engine, "realistic", "unitree_a1", "trot", 60): 4 for engine in ("pybullet", "dart")},
    **{(engine, preset, "unitree_a1", "crawl", 20): 4 for engine in ("mujoco", "dart") for preset in ("realistic", "stress")},
}  # fmt: skip
TARGETS = {
    ("realistic", 20): (3, 3, 8),
    ("stress", 20): (5, 5, 12),
    ("realistic", 60): (2, 2, np.inf),
}  # [mm], of trots
LIFTS = 60.0  # [s] of calibrations that are compared with trots, on an A1
# Payloads of calibrations whose recordings become logs, and the decimation of joints and IMU, and the missing quantity.
LOADS = {"unitree_a1": "1.5,0.05,-0.02,0.06", "go2": "1.5,0.05,0.02,0.06", "solo12": "0.3,0.03,0.01,0.04"}
WAYS: dict[str, tuple[int, int, str] | None] = {
    "events": None,
    "log, 500 Hz": (1, 1, ""),
    "log, joints 100 Hz, IMU 250 Hz": (5, 2, ""),
    "log, 50 Hz": (10, 10, ""),
    "log, 500 Hz, no velocities": (1, 1, "velocity"),
    "log, 500 Hz, orientation for gyroscope": (1, 1, "gyroscope"),
}
PULL = 0.5  # [1/s], common gain of the filter's correction by the accelerometer
RATE, POSITION_NOISE, ANGLE_NOISE = 200.0, 3e-4, 1e-3  # [Hz], [m], [rad], of a base's pose
FILES = ("p_sense.csv", "v_sense.csv", "tau_sense.csv")
SOURCES = {"pose and gyroscope": FILES, "pose": FILES[::2]}


def scaled(truth: InertialParameters, seed: int) -> BayesianMethod:
    """Return the method with the reading of the seed's scale."""
    mass = weighed(truth.mass, np.random.default_rng([seed, 77]))
    return BayesianMethod(mass=mass, mass_std=SCALE_ERROR * mass)


def walk(engine: str, preset: str, name: str, gait: str, duration: int, seed: int) -> Row:
    """Return the row of a walk; in MuJoCo also of a calibration of the same robot."""
    robot = robot_called(name)
    scale = nominal_stance(robot).scale
    payload = payload_on_trunk(robot, seed)
    with world(engine, preset, robot, payload, seed) as (platform, truth):
        recording = GAITS[gait](platform, robot, (1 + duration) * scale.time, phase=float(seed))
    method = scaled(truth, seed)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "walk.csv")
        write_table(recording, file)
        row = judged(estimate_log(robot, read_log(file, robot), method).result, truth)
    if engine == "mujoco" and gait == "trot":
        with world(engine, preset, robot, payload, seed) as (platform, truth):
            lifted = calibrate(platform, robot, replace(method, duration=LIFTS * scale.time))
        row["lifts"] = judged(lifted, truth)
    return row


def show_walks(rows: list[Row]) -> Iterator[str]:
    yield "## Simulated walks"
    yield ""
    yield (
        "A trot with varying speed, sidesteps and turns, or a crawl, one foot after the other. Targets of trots: CoM x, y, z "
        "3, 3, 8 mm (`realistic`), 5, 5, 12 mm (`stress`), 2 mm in the plane in 60 s, coverage 90 %. DART, PyBullet and Drake "
        "lack springs, backlash, rotor spin, soft and rolling feet; PyBullet and Drake also the cable, so their `stress` is "
        "milder. A crawl uses joint torques; height and inertia are not identified. *Silent*: runs with an error above "
        f"{SILENT:g} standard deviations and no failed check."
    )
    yield ""
    head = (
        "engine", "preset", "robot", "gait", "duration [s]", "n", "CoM x, y, z [mm]", "file", "Ixx, Iyy, Izz [%]", "coverage",
        "failed checks", "silent",
    )  # fmt: skip
    yield from markdown(head, (_walk_line(case, of) for case in WALKS if (of := _rows_of(rows, case))))
    if both := [row for row in rows if "lifts" in row]:
        yield ""
        yield from agreement(both)


def _rows_of(rows: Sequence[Row], case: Case) -> list[Row]:
    return [row for row in rows if tuple(row["case"][:-1]) == case]


def _walk_line(case: Case, rows: list[Row]) -> list[str]:
    _, preset, _, gait, duration = case
    error, model = rms(relative(rows)), rms(relative(rows, "file_error"))
    most = TARGETS.get((preset, duration), np.inf) if gait == "trot" else np.inf
    return [
        *map(str, case), str(len(rows)), figures(error[1:4], ".1f", most), figures(model[1:4], ".1f"),
        figures(error[4:7], ".0f"), coverage(rows, 0.9), str(sum(bool(row["alarms"]) for row in rows)),
        str(sum(map(is_silent, rows))),
    ]  # fmt: skip


def agreement(rows: list[Row]) -> Iterator[str]:
    """Yield the comparison of lifts and trot of the same robots."""
    lifts = [row["lifts"] for row in rows]
    apart = column(rows, "error") - column(lifts, "error")
    both = np.hypot(column(rows, "sd"), column(lifts, "sd"))
    yield (
        f"Lifts and trot of the same {len(rows)} robots in MuJoCo ({LIFTS:.0f} s of calibration): "
        f"{np.mean(np.abs(apart) <= NORMAL_95 * both):.0%} of the differences are within the combined intervals. Rms of the "
        "difference over the combined standard deviation:"
    )
    yield ""
    yield from markdown(COMPONENTS, [[f"{value:.2f}" for value in rms(apart / both)]])


def without_events(name: str, seed: int) -> Row:
    """Return the row of a calibration, and of its recordings as logs, by way."""
    robot, recordings = robot_called(name), list[Recording]()
    with simulate(robot, "realistic", LOADS[name], seed) as simulation:
        own = calibrate(simulation.platform, robot, keep=recordings.append)
        truth = simulation.truth.composite
    logs = {way: assemble(robot, raw_log(recordings, *steps)) for way, steps in WAYS.items() if steps is not None}
    row: Row = {way: judged(estimate_log(robot, log).result, truth) for way, log in logs.items()}
    own_row = judged(own, truth)
    return {**row, "events": own_row, "error": own_row["error"], "sd": own_row["sd"]}


def raw_log(recordings: list[Recording], joint_step: int, imu_step: int, without: str) -> RawLog:
    """Return all recordings as one log, with every so many samples of joints and IMU, and without a quantity."""
    log = replace(Recording.concatenate(recordings), events=())
    joints, imu = log.joints, log.imu
    velocity = None if without == "velocity" or joints.velocity is None else joints.velocity[::joint_step]
    torque = None if joints.torque is None else joints.torque[::joint_step]
    raw_joints = RawJoints(
        joints.time[::joint_step], log.joint_names, joints.position[::joint_step], velocity, torque
    )  # fmt: skip
    sensed = (imu.time[::imu_step], imu.angular_velocity_in_imu[::imu_step], imu.acceleration_in_imu[::imu_step])
    if without == "gyroscope":
        return RawLog(raw_joints, RawImu(sensed[0], None, sensed[2], fused(*sensed)))
    return RawLog(raw_joints, RawImu(*sensed))


def fused(time: np.ndarray, gyroscope: np.ndarray, accelerometer: np.ndarray) -> np.ndarray:
    """Return the (n, 4) orientation of a complementary filter, w first."""
    vertical = accelerometer / np.linalg.norm(accelerometer, axis=1)[:, None]
    now = Rotation.align_vectors([[0.0, 0.0, 1.0]], vertical[:1])[0].as_matrix()
    found = np.empty((len(time), 3, 3))
    for k, step in enumerate(np.diff(time, prepend=time[0])):
        x, y, z = (gyroscope[k] + PULL * np.cross(vertical[k], now[2])) * step
        now = now @ np.array([[1, -z, y], [z, 1, -x], [-y, x, 1]])
        if k % 10 == 0:
            now = Rotation.from_matrix(now).as_matrix()
        found[k] = now
    return np.roll(Rotation.from_matrix(found).as_quat(), 1, axis=1)


def show_without_events(rows: list[Row]) -> Iterator[str]:
    yield "## Calibrations as logs without events"
    yield ""
    yield "`realistic`, a payload, no scale; the motions are detected in one long log."
    yield ""
    head = (
        "robot",
        "n",
        "estimated from",
        "mass [%]",
        "CoM x, y, z [mm]",
        "its intervals +- [mm]",
        "Ixx, Iyy, Izz [%]",
        "coverage",
    )
    yield from markdown(head, _ways(rows))


def _ways(rows: list[Row]) -> Iterator[list[str]]:
    for name in LOADS:
        for way in WAYS:
            if of := [row[way] for row in rows if row["case"][0] == name]:
                error = rms(relative(of))
                wide = 1e3 * NORMAL_95 * column(of, "sd")[:, 1:4].mean(axis=0)
                yield [
                    name, str(len(of)), way, f"{error[0]:.1f}", figures(error[1:4]), figures(wide), figures(error[4:7], ".1f"),
                    coverage(of),
                ]  # fmt: skip


def with_pose(name: str, seed: int) -> Row:
    """Return the row of a trot with the base's pose, by the source of the angular velocity."""
    robot = robot_called(name)
    recording, poses, truth = walk_with_poses(robot, seed)
    row: Row = {}
    with tempfile.TemporaryDirectory() as folder:
        write_poses(recording, poses, seed, Path(folder))
        for source, files in SOURCES.items():
            paths = [Path(folder, file) for file in files]
            log = read_log(paths[0], robot, columns=proposed(robot, paths), tables=paths[1:])
            row[source] = judged(estimate_log(robot, log, scaled(truth, seed)).result, truth)
    return row | {part: row["pose"][part] for part in ("error", "sd")}


def walk_with_poses(robot: RobotModel, seed: int) -> tuple[Recording, np.ndarray, InertialParameters]:
    """Return a trot of 20 s, the (n, 8) times, positions and quaternions of its base, and the true body."""
    poses: list[tuple[float, ...]] = []
    with simulate(robot, "realistic", payload_on_trunk(robot, seed), seed) as simulation:
        platform = simulation.platform
        step = platform.step

        def seen(*arguments: object, **named: object) -> object:
            state = step(*arguments, **named)
            poses.append((state.time, *platform._data.qpos[:7]))
            return state

        platform.step = seen
        recording = GAITS["trot"](platform, robot, 21.0 * nominal_stance(robot).scale.time, phase=float(seed))
        return recording, np.array(poses), simulation.truth.composite


def write_poses(recording: Recording, poses: np.ndarray, seed: int, folder: Path) -> None:
    """Write files without names, in Pinocchio's order of a free joint."""
    random, joints, imu = np.random.default_rng([seed, 79]), recording.joints, recording.imu
    time = np.arange(joints.time[0] + 0.02, joints.time[-1] - 0.02, 1 / RATE)

    def at(times: np.ndarray, values: np.ndarray) -> np.ndarray:
        return np.column_stack([np.interp(time, times, of_axis) for of_axis in values.T])

    position = at(poses[:, 0], poses[:, 1:4]) + random.normal(0, POSITION_NOISE, (len(time), 3))
    noise = Rotation.from_rotvec(random.normal(0, ANGLE_NOISE, (len(time), 3)))
    quaternion = (Rotation.from_quat(np.roll(at(poses[:, 0], poses[:, 4:]), -1, axis=1)) * noise).as_quat()
    tables = (
        [position, quaternion, at(joints.time, joints.position)],
        [
            np.gradient(position, time, axis=0),
            at(imu.time, imu.angular_velocity_in_imu),
            at(joints.time, joints.velocity),
        ],
        [at(joints.time, joints.torque)],
    )
    for name, table in zip(FILES, tables, strict=True):
        np.savetxt(folder / name, np.hstack([time[:, None], *table]), delimiter=",", fmt="%.9f")


def proposed(robot: RobotModel, paths: list[Path]) -> Columns:
    """Return the columns that equipoise proposes for files without names."""
    report: object = None
    try:
        read_log(paths[0], robot, tables=paths[1:])
    except RecordingError as error:
        report = error.report
    assert isinstance(report, ColumnProposal)
    return Columns.from_text(report.text, "the proposal")


def show_with_pose(rows: list[Row]) -> Iterator[str]:
    yield "## Walks with the base's pose in place of an accelerometer"
    yield ""
    yield (
        f"Trots of 20 s in MuJoCo, `realistic`: poses with noise of {1e3 * POSITION_NOISE:g} mm and {1e3 * ANGLE_NOISE:g} "
        f"mrad at {RATE:.0f} Hz, in files without names, read with the proposed columns. Such a log determines mass and "
        "planar CoM. Moments of inertia are worse than the file's. *error / std*: rms, of all ten parameters."
    )
    yield ""
    head = (
        "robot",
        "source",
        "n",
        "CoM x, y, z [mm]",
        "file",
        "Ixx, Iyy, Izz [%]",
        "file",
        "error / std",
        "coverage",
        "failed checks",
    )
    yield from markdown(head, _sources(rows))


def _sources(rows: list[Row]) -> Iterator[list[str]]:
    for name in dict.fromkeys(row["case"][0] for row in rows):
        for source in SOURCES:
            of = [row[source] for row in rows if row["case"][0] == name]
            error, model = rms(relative(of)), rms(relative(of, "file_error"))
            z = rms((column(of, "error") / column(of, "sd")).ravel())
            yield [
                name, source, str(len(of)), figures(error[1:4], ".1f"), figures(model[1:4], ".1f"), figures(error[4:7], ".0f"),
                figures(model[4:7], ".0f"), f"{z:.2f}", coverage(of), str(sum(bool(row["alarms"]) for row in of)),
            ]  # fmt: skip


def replayed(name: str, loaded: bool, seed: int) -> Row:
    """Return the errors of replayed lifts [mm]: of the run itself, and of a second run with the body of the first."""
    robot, a1 = robot_called(name), robot_called("unitree_a1")
    size = nominal_stance(robot).hip_height / nominal_stance(a1).hip_height
    body = InertialParameters(1.5 * robot.mass / a1.mass, size * np.array([0.1, 0, 0.08]), np.zeros((3, 3)))

    def calibrated(noise_seed: int, method: BayesianMethod) -> Calibration:
        with simulate(robot, "realistic", Payload(body) if loaded else None, seed, noise_seed=noise_seed) as simulation:
            return calibrate(simulation.platform, robot, method)

    first = calibrated(2 * seed, BayesianMethod())
    second = calibrated(2 * seed + 1, BayesianMethod(duration=50.0))
    own, other = validate(first), validate(second, {"first run": first})
    return {
        "own": [1e3 * own.error(of) for of in (FOUND, MODEL)],
        "second": [1e3 * other.error(of) for of in ("first run", MODEL)],
        "held out": [] if first.held_out is None else [1e3 * first.held_out.error(of) for of in (FOUND, MODEL)],
    }


def show_replays(rows: list[Row]) -> Iterator[str]:
    yield "## Replay validation"
    yield ""
    yield (
        "Lifts of calibrations of two minutes without a scale, `realistic`, simulated again "
        "([method](../../docs/simulation-studies.md#replay-validation)). Root mean square over lifts of measured minus "
        "simulated tilt at the end, as a distance at the CoM [mm], with the estimate and with the model file; median over "
        "robots. Lifts of a second run with other noise are replayed with the body of the first, which does not use them. "
        "*Held out*: prediction by the tilt equation."
    )
    yield ""
    head = ("robot", "payload", "n", "estimate, model file", "second run: body of the first, model file", "held out")
    yield from markdown(head, _replays(rows))


def _replays(rows: list[Row]) -> Iterator[list[str]]:
    for name, loaded in dict.fromkeys(tuple(row["case"][:2]) for row in rows):
        of = [row for row in rows if row["case"][:2] == [name, loaded]]
        medians = [np.median(column(of, what), axis=0) for what in ("own", "second", "held out")]
        payload = "1.5 kg of an A1" if loaded else "none"
        yield [name, payload, str(len(of)), *(", ".join(f"{value:.2f}" for value in pair) for pair in medians)]


PAGE = Page(
    "logs",
    f"""# Logs

`make bench-logs`; seeds from {FIRST_SEED:,}. Root mean square errors of the whole robot at the nominal stance, estimate minus
truth; *file*: the model file, without the payload. Coverage: share of 95 % intervals that contain the truth. Bold: target
missed.""",
    (
        Table(
            "walk",
            walk,
            cases_of(WALKS),
            show_walks,
        ),
        Table("without events", without_events, cases_of({(name,): 4 for name in LOADS}), show_without_events),
        Table("pose", with_pose, cases_of({("unitree_a1",): 4, ("go2",): 4}), show_with_pose),
        Table(
            "replay",
            replayed,
            cases_of({("unitree_a1", True): 3, ("unitree_a1", False): 3, ("go2", True): 3}),
            show_replays,
        ),
        *real_logs.TABLES,
    ),
)

if __name__ == "__main__":
    main(PAGE)
