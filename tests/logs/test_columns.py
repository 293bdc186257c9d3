"""Tables with foreign column names, files of arrays, and their errors."""

import io
import json
import pickle
from dataclasses import replace

import numpy as np
import pytest
from foreign_logs import columns_of, write_csv, write_parquet
from hypothesis import given
from hypothesis import strategies as st
from scipy.io import savemat
from scipy.spatial.transform import Rotation

from equipoise.cli import main
from equipoise.errors import RecordingError, SettingsError
from equipoise.logs.reader import is_log, read_log
from equipoise.logs.tables.by_name import named
from equipoise.logs.tables.column_names import UNITS, Columns
from equipoise.logs.tables.files import open_table
from equipoise.recording.recording import ImuStream, JointStream, Recording
from equipoise.robot.kinematics import feet_under_base, foot_positions, inverse_kinematics
from equipoise.robot.stance import nominal_stance
from equipoise.robot.statics import static_torques

RATE = 100
LEANS = ((0, 0), (0.2, 0), (-0.2, 0.1), (0, -0.2), (0.15, 0.15), (-0.1, -0.1), (0.05, 0.2))  # [rad] of roll, pitch


@pytest.fixture(scope="module")
def leaning(a1):
    """Recording and orientation of a robot that leans on four feet from rest to rest, with perfect sensors."""
    stance = nominal_stance(a1)
    feet, still, moving = foot_positions(a1, stance.joint_position), 2 * RATE, RATE
    postures = [
        inverse_kinematics(
            a1, feet_under_base(feet, np.zeros(3), rotation_of(*lean).as_matrix()), stance.joint_position
        )
        for lean in LEANS
    ]
    torques = [static_torques(a1, posture, a1.legs) for posture in postures]
    s = (1 - np.cos(np.pi * np.arange(moving) / moving)) / 2
    share = np.concatenate([k + np.concatenate([np.zeros(still), s]) for k in range(len(LEANS) - 1)])
    time = 5.0 + np.arange(len(share)) / RATE

    def along(values):
        return np.column_stack([np.interp(share, range(len(LEANS)), column) for column in np.array(values).T])

    turned = rotation_of(*along(LEANS).T)
    rate = np.gradient(along(LEANS), time, axis=0)
    body_rate = np.column_stack(
        [rate[:, 0], rate[:, 1] * np.cos(along(LEANS)[:, 0]), -rate[:, 1] * np.sin(along(LEANS)[:, 0])]
    )
    position = along(postures)
    joints = JointStream(time, position, np.gradient(position, time, axis=0), along(torques))
    imu = ImuStream(time, body_rate, turned.inv().apply([0, 0, 9.81]))
    return Recording(a1.joint_names, joints, imu), np.roll(turned.as_quat(), 1, axis=1)


def rotation_of(roll, pitch):
    return Rotation.from_euler("ZYX", np.column_stack([np.zeros_like(roll), pitch, roll]).squeeze())


def same(found, log, rtol=1e-9):
    np.testing.assert_allclose(found.joints.time, log.joints.time - log.joints.time[0], atol=1e-6)
    for mine, theirs in ((found.joints, log.joints), (found.imu, log.imu)):
        for name in vars(theirs):
            if name not in ("time", "pose_noise"):
                np.testing.assert_allclose(
                    getattr(mine, name), getattr(theirs, name), rtol=rtol, atol=1e-6, err_msg=name
                )


# --- tables of others, as people write them


def by_index(path, robot, log):
    joints, imu = log.joints, log.imu
    np.savez(
        path.with_suffix(".npz"), t=joints.time, q=joints.position, dq=joints.velocity, tau=joints.torque,
        gyro=imu.angular_velocity_in_imu, acc=imu.acceleration_in_imu,
        names=np.array(["a", "b"]), video=np.zeros((7, 2, 2)),
    )  # fmt: skip
    return path.with_suffix(".npz")


def without_words(path, robot, log):
    joints, imu = log.joints, log.imu
    np.savez(
        path.with_suffix(".npz"), a=joints.time, b=joints.position, c=joints.velocity, d=joints.torque,
        e=imu.angular_velocity_in_imu, f=imu.acceleration_in_imu,
    )  # fmt: skip
    return path.with_suffix(".npz")


def a_matlab_structure(path, robot, log):
    joints, imu = log.joints, log.imu
    robot_side = {"pos": joints.position.T, "vel": joints.velocity.T, "tau": joints.torque.T}
    imu_side = {"acc": imu.acceleration_in_imu.T, "gyro": imu.angular_velocity_in_imu.T}
    savemat(
        path.with_suffix(".mat"),
        {"log": {"t": joints.time[:, None], "imu": imu_side, "joint": robot_side, "name": "run 3"}},
    )
    return path.with_suffix(".mat")


def words_of_others(path, robot, log):
    """Legs, places and quantities in other words, other sensors, and a counter that increases evenly too."""
    joints, imu = log.joints, log.imu
    place = {"hip": "abad", "thigh": "hip", "calf": "knee"}
    columns = {
        "frame": np.arange(len(joints.time)) * 0.004,
        "Time(s)": joints.time,
        "FR_Force": np.full(len(joints.time), 30.0),
    }
    for word, values in (("Pos", joints.position), ("Vel", joints.velocity), ("Tau", joints.torque)):
        for name, column in zip(robot.joint_names, values.T, strict=True):
            leg, kind, _ = name.split("_")
            columns[f"Joint{word}{leg}_{place[kind]}"] = column
    for letter, values in (
        ("W", imu.angular_velocity_in_imu),
        ("A", imu.acceleration_in_imu),
        ("V", imu.acceleration_in_imu / 9),
    ):
        columns |= {f"Base{letter}{axis}": column for axis, column in zip("xyz", values.T, strict=True)}
    return write_csv(path.with_suffix(".csv"), columns)


def paths_of_topics(path, robot, log):
    """Return columns named as in Parquet files of bags."""
    columns = {"/joint_states/header/stamp": log.joints.time}
    for word, values in (
        ("position", log.joints.position),
        ("velocity", log.joints.velocity),
        ("effort", log.joints.torque),
    ):
        columns |= {f"/joint_states/{name}/{word}": c for name, c in zip(robot.joint_names, values.T, strict=True)}
    for word, values in (
        ("angular_velocity", log.imu.angular_velocity_in_imu),
        ("linear_acceleration", log.imu.acceleration_in_imu),
    ):
        columns |= {f"/imu/data/{word}/{axis}": column for axis, column in zip("xyz", values.T, strict=True)}
    return write_parquet(path.with_suffix(".parquet"), columns)


def champs_names(path, robot, log):
    """Joints of CHAMP, of which some have a "leg" in their names, and the right ones come first."""
    joints = {"hip": "hip", "thigh": "upper_leg", "calf": "lower_leg"}
    legs = {"FL": "lf", "FR": "rf", "RL": "lh", "RR": "rh"}
    order = [robot.joint_names.index(f"{leg}_{joint}_joint") for leg in ("FR", "FL", "RR", "RL") for joint in joints]
    columns = {"time_ns": np.round(log.joints.time * 1e9).astype(np.int64)}
    for word, values in (("pos", log.joints.position), ("vel", log.joints.velocity), ("eff", log.joints.torque)):
        for index in order:
            leg, joint, _ = robot.joint_names[index].split("_")
            columns[f"{word}_{legs[leg]}_{joints[joint]}_joint"] = values[:, index]
    for word, values in (("gyro", log.imu.angular_velocity_in_imu), ("acc", log.imu.acceleration_in_imu)):
        columns |= {f"{word}_{axis}": column for axis, column in zip("xyz", values.T, strict=True)}
    return write_csv(path.with_suffix(".csv"), columns)


@pytest.mark.parametrize(
    "write",
    [champs_names, by_index, a_matlab_structure, words_of_others, paths_of_topics],
)
def test_the_proposal_for_a_table_with_other_names_reads_it(a1, leaning, tmp_path, write):
    log, _ = leaning
    path = write(tmp_path / "log", a1, log)
    assert is_log(path)
    with pytest.raises(
        RecordingError, match=r"The names of its columns suggest the mapping below. Check this proposal, save it"
    ) as raised:
        read_log(path, a1)
    assert raised.value.details["columns"] == raised.value.report.text
    assert raised.value.exit_code == RecordingError.exit_code
    (tmp_path / "columns.toml").write_text(raised.value.report.text, encoding="utf-8")
    same(read_log(path, a1, columns=Columns.from_toml(tmp_path / "columns.toml")).recording, log, rtol=1e-6)


@pytest.mark.parametrize(
    ("name", "kind", "part"),
    [
        ("%time", "time", ""), ("/imu/data/header/stamp", "time", ""), ("frame_index", None, None),
        ("/imu/data/linear_acceleration/x", "accelerometer", "x"), ("imu.accelerometer[2]", "accelerometer", "2"),
        ("ax", "accelerometer", "x"), ("angular_acceleration_x", None, None), ("base_ang_vel[0]", "gyro", "0"),
        ("BaseWz", "gyro", "z"), ("base_lin_vel_x", None, None), ("q_w", "orientation", "w"),
        ("base_roll", "orientation", "roll"), ("imu_rpy[2]", "orientation", "yaw"),
        ("motor_state[3].q", "position", "3"), ("motor_state[3].tau_est", "torque", "3"),
        ("motor_state[3].temperature", None, None), ("left_front_hip_roll_pos", "position", "left_front_hip_roll"),
        ("/joint_states/LF_HAA/effort", "torque", "lf_haa"), ("qd_3", "velocity", "3"), ("ddq_3", None, None),
        ("target_q_FL_calf", "command", "fl_calf"), ("FR_Force", "foot_force", "FR"), ("RL_foot_force_x", None, None),
            ("FL_knee_vel_cmd", None, None),
    ],
)  # fmt: skip
def test_names_that_people_give_columns(name, kind, part):
    found = named(name)
    assert (kind, part) == ((None, None) if found is None else (found.kind, found.part))


def test_a_proposal_states_reasons_units_and_unused_columns(a1, leaning, tmp_path):
    with pytest.raises(RecordingError) as raised:
        read_log(by_index(tmp_path / "log", a1, leaning[0]), a1)
    for line in (
        "# time: by name; consecutive samples are less than half a second apart in s",
        "# position: numbered columns, in the order of the model's joints: compare joint by joint; is the unit rad?",
        "# gyro: by name; is the unit rad/s?", 'position.FL_hip_joint = "q[0]"',
        "\n# not used: names (2,), video (7, 2, 2)\n",
    ):  # fmt: skip
        assert line in raised.value.report.text, line


def test_names_without_meaning_are_refused_with_the_columns_and_the_mapping_to_write(a1, leaning, tmp_path):
    with pytest.raises(
        RecordingError, match=r"but nothing for time, .*, position.JOINT: complete these lines"
    ) as raised:
        read_log(without_words(tmp_path / "log", a1, leaning[0]), a1)
    for line in (
        '# missing: time = "..."',
        '# missing: position.FL_hip_joint = "..."',
        "# not used: a, b[0] to b[11], c[0] to c[11]",
    ):
        assert line in raised.value.report.text, line
    written = {"time": "a", **{f"gyro.{axis}": f"e[{k}]" for k, axis in enumerate("xyz")}}
    written |= {f"accelerometer.{axis}": f"f[{k}]" for k, axis in enumerate("xyz")}
    for kind, array in (("position", "b"), ("velocity", "c"), ("torque", "d")):
        written |= {f"{kind}.{joint}": f"{array}[{k}]" for k, joint in enumerate(a1.joint_names)}
    same(read_log(tmp_path / "log.npz", a1, columns=Columns(written)).recording, leaning[0])


def test_a_proposal_is_completed_by_its_missing_lines(a1, leaning, tmp_path):
    """A table of units would take the lines that follow it."""
    log = leaning[0]
    turning = replace(log.imu, angular_velocity_in_imu=np.degrees(log.imu.angular_velocity_in_imu))
    columns = columns_of(replace(log, imu=turning))
    path = write_csv(
        tmp_path / "log.csv", {{"time": "a", "gyro.x": "b"}.get(name, name): columns[name] for name in columns}
    )
    proposal = proposal_for(path, a1, Columns(units={"gyro": "deg/s"}))
    for name, theirs in (("time", "a"), ("gyro.x", "b")):
        assert f'# missing: {name} = "..."' in proposal
        proposal = proposal.replace(f'# missing: {name} = "..."', f'{name} = "{theirs}"')
    same(read_log(path, a1, columns=Columns.from_text(proposal, "the proposal")).recording, log, rtol=1e-6)


def proposal_for(path, robot, columns=None):
    with pytest.raises(RecordingError) as raised:
        read_log(path, robot, columns=columns)
    return raised.value.report.text


def arrays_of(log):
    joints, imu = log.joints, log.imu
    sensed = {"gyro": imu.angular_velocity_in_imu, "acc": imu.acceleration_in_imu}
    return {"t": joints.time, "q": joints.position, "dq": joints.velocity} | sensed


def test_whole_numbers_are_numbers_of_any_unit(a1, leaning, tmp_path):
    milli_g = np.round(leaning[0].imu.acceleration_in_imu / 9.80665e-3).astype(np.int16)
    np.savez(tmp_path / "log.npz", **arrays_of(leaning[0]) | {"acc": milli_g})
    proposed = Columns.from_text(proposal_for(tmp_path / "log.npz", a1), "it")
    assert proposed.names["accelerometer.x"] == "acc[0]"
    read = read_log(tmp_path / "log.npz", a1, columns=replace(proposed, units={"accelerometer": "mg"})).recording
    np.testing.assert_allclose(read.imu.acceleration_in_imu, leaning[0].imu.acceleration_in_imu, atol=0.01)


@pytest.mark.parametrize("first", [0, 1])
def test_names_that_count_are_names(a1, leaning, tmp_path, first):
    """Pandas numbers columns without names."""
    path, names = tmp_path / "log.csv", [str(first + index) for index in range(4)]
    path.write_text("\n".join([",".join(names), "0.1,1,2,3", "0.2,4,5,6"]))
    assert open_table(path).names == tuple(names)
    assert open_table(path).column(names[3]).tolist() == [3, 6]


def test_a_floating_base_before_the_joints_is_passed_over(a1, leaning, tmp_path):
    arrays, rows = arrays_of(leaning[0]), len(leaning[0].joints.time)
    base = {"q": np.zeros((rows, 7)), "dq": np.zeros((rows, 6))}
    np.savez(tmp_path / "log.npz", **arrays | {name: np.hstack([base[name], arrays[name]]) for name in base})
    proposed = Columns.from_text(proposal_for(tmp_path / "log.npz", a1), "it")
    assert [proposed.names[f"position.{joint}"] for joint in a1.joint_names] == [f"q[{at}]" for at in range(7, 19)]
    assert [proposed.names[f"velocity.{joint}"] for joint in a1.joint_names] == [f"dq[{at}]" for at in range(6, 18)]


def test_a_row_counter_is_not_a_time(a1, leaning, tmp_path):
    columns = columns_of(leaning[0])
    stamp = columns.pop("time") + np.random.default_rng(0).uniform(0, 0.5, len(columns["gyro.x"]))
    path = write_csv(tmp_path / "log.csv", {"seq": np.arange(len(stamp)), "stamp": stamp, **columns})
    assert Columns.from_text(proposal_for(path, a1), "it").names["time"] == "stamp"


@pytest.mark.parametrize("unit", ["ns", "ms"])
def test_a_column_called_time_need_not_be_in_seconds(a1, leaning, tmp_path, unit):
    """Next to others with different names."""
    columns = columns_of(leaning[0])
    columns["gyro_x"] = columns.pop("gyro.x")
    columns["time"] = np.round(columns["time"] * {"ns": 1e9, "ms": 1e3}[unit]).astype(np.int64)
    path = write_csv(tmp_path / "log.csv", columns)
    proposed = Columns.from_text(proposal_for(path, a1), "it")
    assert proposed.units == {"time": unit}
    same(read_log(path, a1, columns=proposed).recording, leaning[0], rtol=1e-6)


def test_a_stamp_before_the_first_one_is_negative(tmp_path):
    """Drivers write zeros before they have the time; stamps are unsigned."""
    np.savez(tmp_path / "log.npz", t=np.array([5_000_000_000, 0, 5_002_000_000], dtype=np.uint64))
    np.testing.assert_allclose(open_table(tmp_path / "log.npz").clock("t"), [0, -5e9, 2e6])


def test_angles_in_degrees_are_refused_unless_their_unit_is_given(a1, leaning, tmp_path):
    """The robot walks straight."""
    log, _ = leaning
    roll, pitch = 2 * np.sin(4 * log.imu.time), 2 * np.cos(4 * log.imu.time)
    up = rotation_of(np.radians(roll), np.radians(pitch)).inv().apply([0, 0, 9.81])
    log = replace(log, imu=replace(log.imu, acceleration_in_imu=up))
    columns = {name: values for name, values in columns_of(log).items() if not name.startswith("gyro")}
    path = write_csv(tmp_path / "log.csv", {**columns, "roll": roll, "pitch": pitch, "yaw": 0 * roll})
    proposed = Columns.from_text(proposal_for(path, a1), "it")
    with pytest.raises(RecordingError, match="the orientation's vertical is"):
        read_log(path, a1, columns=proposed)
    read_log(path, a1, columns=replace(proposed, units={"orientation": "deg"}))


def test_only_a_name_makes_columns_a_gyroscope(a1, leaning, tmp_path):
    columns = columns_of(leaning[0])
    for axis, other in zip("xyz", "prs", strict=True):
        columns[other] = columns.pop(f"gyro.{axis}")
        columns[f"gyro_{axis}"] = 0 * columns[other]
    proposed = proposal_for(write_csv(tmp_path / "log.csv", columns), a1)
    assert '# gyro: by name; is the unit rad/s?\ngyro.x = "gyro_x"' in proposed
    assert "# not used: p, r, s" in proposed


def test_names_that_state_a_quantity_come_before_names_of_joints_alone(a1, leaning, tmp_path):
    columns = {name: values for name, values in columns_of(leaning[0]).items() if not name.startswith("position")}
    positions = leaning[0].joints.position.T
    bare = {name: 0 * column for name, column in zip(a1.joint_names, positions, strict=True)}
    named = {f"q_{name}": column for name, column in zip(a1.joint_names, positions, strict=True)}
    proposed = Columns.from_text(proposal_for(write_csv(tmp_path / "log.csv", columns | bare | named), a1), "it")
    assert all(proposed.names[f"position.{name}"] == f"q_{name}" for name in a1.joint_names)


def test_columns_without_a_suggestion_are_named(a1, leaning, tmp_path):
    columns = columns_of(leaning[0])
    columns = {name: values for name, values in columns.items() if not name.startswith("accelerometer")}
    with pytest.raises(
        RecordingError, match=r"has no accelerometer.x, accelerometer.y, accelerometer.z. .*but nothing for acc"
    ):
        read_log(write_csv(tmp_path / "log.csv", columns), a1)


@pytest.mark.parametrize("angles", [False, True])
def test_an_orientation_is_proposed_where_there_is_no_gyroscope(a1, leaning, tmp_path, angles):
    log, quaternions = leaning
    columns = with_orientation(log, quaternions, angles)
    words = {"roll": "imu_rpy[0]", "pitch": "imu_rpy[1]", "yaw": "imu_rpy[2]"}
    for part in [name.split(".")[1] for name in columns if name.startswith("orientation")]:
        columns[words.get(part, f"q_{part}")] = columns.pop(f"orientation.{part}")
    path = write_csv(tmp_path / "log.csv", columns)
    with pytest.raises(RecordingError) as raised:
        read_log(path, a1)
    proposed = Columns.from_text(raised.value.report.text, "it")
    read = read_log(path, a1, columns=replace(proposed, units={"orientation": "deg" if angles else "rad"}))
    assert any("derived from the fused orientation" in finding.message for finding in read.findings)


# --- columns given by the user


def test_columns_may_be_partial_and_in_other_units(a1, leaning, tmp_path):
    log, _ = leaning
    columns = columns_of(log)
    for axis in "xyz":
        columns[f"w{axis}"] = np.degrees(columns.pop(f"gyro.{axis}"))
        columns[f"accelerometer.{axis}"] = columns[f"accelerometer.{axis}"] / 9.80665
    columns["time"] = 1000 * columns["time"]
    units = 'units.time = "ms"\nunits.gyro = "deg/s"\nunits.accelerometer = "g"\n'
    named = Columns.from_text('gyro.x = "wx"\ngyro.y = "wy"\ngyro.z = "wz"\n' + units, "it")
    for path in (write_csv(tmp_path / "log.csv", columns), write_parquet(tmp_path / "log.parquet", columns)):
        same(read_log(path, a1, columns=named).recording, log)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("gyro.x = ", "cannot be read: "),
        ('gyrox = "wx"', "'gyrox' is not a documented column; did you mean 'gyro.x'"),
        ("gyro.x = 3", r'3 is not a column\'s name; write it as gyro.x = "..."'),
        ('units.gyro = "grad"', "'grad' is not a unit of gyro; those are rad/s, deg/s, rpm"),
        ('units.gyro = ["deg/s"]', r"\['deg/s'\] is not a unit of gyro"),
        ('units.mass = "kg"', "units are of time, position, .*not of 'mass'"),
        ("units = 3", "units are of time"),
    ],
)
def test_a_mistake_in_the_users_columns_is_named(tmp_path, text, message):
    (tmp_path / "columns.toml").write_text(text, encoding="utf-8")
    with pytest.raises(SettingsError, match=message):
        Columns.from_toml(tmp_path / "columns.toml")


def test_an_empty_name_excludes_a_column(a1, leaning, tmp_path):
    path = write_csv(tmp_path / "log.csv", columns_of(leaning[0]))
    columns = Columns.from_text("".join(f'torque.{joint} = ""\n' for joint in a1.joint_names), "it")
    assert read_log(path, a1, columns=columns).recording.joints.torque is None
    columns = Columns.from_text('gyro.x = ""', "it")
    with pytest.raises(RecordingError, match=r"has no gyro.x\. The names .*but nothing for gyro.x") as error:
        read_log(path, a1, columns=columns)
    assert Columns.from_text(error.value.report.text, "it").names == columns.names


def test_columns_missing_from_the_table_are_named(a1, leaning, tmp_path):
    path = write_csv(tmp_path / "log.csv", columns_of(leaning[0]))
    with pytest.raises(
        SettingsError, match=r"maps gyro.x to 'gyr.x', which the table .* does not have; did you mean 'gyro.x'"
    ):
        read_log(path, a1, columns=Columns({"gyro.x": "gyr.x"}))
    with pytest.raises(SettingsError, match=r"assigns 'gyro.z' to gyro.x and to gyro.z"):
        read_log(path, a1, columns=Columns({"gyro.x": "gyro.z", "gyro.z": "gyro.z"}))
    with pytest.raises(SettingsError, match="cannot be read"):
        Columns.from_toml(tmp_path / "none.toml")
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "log.db3").touch()
    with pytest.raises(
        SettingsError,
        match=r"--columns, --rate and several files are for tables \(.csv, .tsv, .dat, .*, .mat\), and .* is not one",
    ):
        read_log(tmp_path / "bag", a1, columns=Columns())


OURS = st.sampled_from(["time", "gyro.x", "accelerometer.z", "orientation.roll"]) | st.builds(
    "{}.{}".format, st.sampled_from(["position", "velocity", "torque", "command"]), st.text(min_size=1)
)
NAMES = st.dictionaries(OURS, st.text(min_size=1), max_size=6)
SOME_UNITS = st.fixed_dictionaries({}, optional={kind: st.sampled_from([*of]) for kind, of in UNITS.items()})


@given(names=NAMES, units=SOME_UNITS)
def test_columns_are_read_as_written(names, units):
    """Names have any characters; columns with documented names need no line."""
    read = Columns.from_text(Columns(names, units).to_toml(), "it")
    assert read.names == {ours: theirs for ours, theirs in names.items() if ours != theirs}
    assert read.units == units


# --- files of arrays


def test_arrays_of_our_names_are_read_from_every_kind_of_file(a1, leaning, tmp_path):
    log, columns = leaning[0], columns_of(leaning[0])
    np.savez(tmp_path / "log.npz", **columns, pickled=np.array([{"a": 1}], dtype=object))
    rows = np.array([*zip(*columns.values(), strict=True)], dtype=[(name, float) for name in columns])
    np.save(tmp_path / "log.npy", rows)
    (tmp_path / "renamed.npz").write_bytes((tmp_path / "log.npy").read_bytes())
    for name in ("log.npz", "log.npy", "renamed.npz"):
        same(read_log(tmp_path / name, a1).recording, log)


def test_images_and_gains_in_a_log_are_skipped(a1, leaning, tmp_path):
    arrays, rows = arrays_of(leaning[0]), len(leaning[0].joints.time)
    others = {f"gain{k}": np.ones(12) for k in range(9)}
    np.savez(tmp_path / "log.npz", foot=np.zeros((rows, 4)), camera=np.zeros((rows, 9, 9)), **others, **arrays)
    gains = ", ".join(f"{name} (12,)" for name in others)
    proposed = proposal_for(tmp_path / "log.npz", a1).replace("\n# ", " ")
    assert f"not used: foot[0] to foot[3], camera ({rows}, 9, 9), {gains}" in proposed


def test_arrays_of_two_lengths_are_refused_by_name(a1, leaning, tmp_path):
    arrays = arrays_of(leaning[0])
    imu = {name: np.repeat(arrays.pop(name), 2, axis=0) for name in ("gyro", "acc")}
    np.savez(tmp_path / "log.npz", q=arrays["q"], t=arrays["t"], **imu)
    rows = len(arrays["t"])
    with pytest.raises(
        RecordingError,
        match=rf"arrays of {rows} samples \(q, t\) and {2 * rows} samples \(gyro, acc\), .*a separate file",
    ):
        read_log(tmp_path / "log.npz", a1)


@pytest.mark.parametrize("suffix", ["pkl", "pickle", "pt", "npy"])
def test_pickles_are_refused_unopened_with_how_to_convert_them(a1, tmp_path, suffix):
    ran = tmp_path / "ran"
    path = tmp_path / f"log.{suffix}"
    if suffix == "npy":
        np.save(path, np.array([Trap(ran)], dtype=object), allow_pickle=True)
    else:
        path.write_bytes(pickle.dumps(Trap(ran)))
    with pytest.raises(RecordingError, match=r"holds Python objects.*numpy.savez\('log.npz', time=") as raised:
        read_log(path, a1)
    loader = {"pt": "torch.load('log.pt')", "npy": "allow_pickle=True"}.get(
        suffix, f"pickle.load(open('log.{suffix}', 'rb'))"
    )
    assert loader in str(raised.value)
    assert not ran.exists()


def test_a_package_may_bring_a_reader_of_pickles(a1, tmp_path, monkeypatch):
    (tmp_path / "log.pkl").touch()

    def read_pickle(path, robot, topics):
        raise RecordingError("asked")

    monkeypatch.setattr("equipoise.logs.reader.READERS", {"pkl": read_pickle})
    with pytest.raises(RecordingError, match="asked"):
        read_log(tmp_path / "log.pkl", a1)


class Trap:
    """Return code that runs when it is unpickled."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return open, (str(self.path), "w")


def test_files_of_arrays_that_hold_no_log(a1, tmp_path):
    np.savez(tmp_path / "words.npz", a=np.array(["x", "y"]))
    with pytest.raises(RecordingError, match=r"holds no arrays of numbers; it holds a \(2,\)"):
        read_log(tmp_path / "words.npz", a1)
    np.savez(tmp_path / "nothing.npz")
    with pytest.raises(RecordingError, match="it holds nothing at all"):
        read_log(tmp_path / "nothing.npz", a1)
    (tmp_path / "log.mat").write_bytes(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + bytes(400))
    with pytest.raises(RecordingError, match=r"version 7.3, which is not read: save it again with save\("):
        read_log(tmp_path / "log.mat", a1)
    for suffix, save in (("npz", np.savez), ("npy", np.save)):
        path = tmp_path / f"log.{suffix}"
        save(path, np.zeros(1000))
        for damaged in (path.read_bytes()[:5000], b"PK nothing", b""):
            path.write_bytes(damaged)
            with pytest.raises(
                RecordingError, match=rf"cannot be read: it is damaged, or not a .{suffix} file"
            ) as raised:
                read_log(path, a1)
            assert "allow_pickle" not in str(raised.value)


# --- a fused orientation


def with_orientation(log, quaternions, angles=False):
    """A table's columns with an orientation in place of the gyroscope."""
    columns = {name: values for name, values in columns_of(log).items() if not name.startswith("gyro")}
    if angles:
        yaw, pitch, roll = Rotation.from_quat(np.roll(quaternions, -1, axis=1)).as_euler("ZYX", degrees=True).T
        return columns | {"orientation.roll": roll, "orientation.pitch": pitch, "orientation.yaw": yaw}
    return columns | {f"orientation.{part}": column for part, column in zip("wxyz", quaternions.T, strict=True)}


@pytest.mark.parametrize("angles", [False, True])
def test_an_orientation_replaces_a_missing_gyroscope(a1, leaning, tmp_path, angles):
    log, quaternions = leaning
    path = write_csv(tmp_path / "log.csv", with_orientation(log, quaternions, angles))
    read = read_log(path, a1, columns=Columns(units={"orientation": "deg"}))
    np.testing.assert_allclose(
        read.recording.imu.angular_velocity_in_imu,
        log.imu.angular_velocity_in_imu,
        atol=0.01 * np.ptp(log.imu.angular_velocity_in_imu),
    )
    assert any("derived from the fused orientation" in finding.message for finding in read.findings)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda q: np.roll(q, -1, axis=1), "is w the last"),
        (lambda q: q * [1, -1, -1, -1], "is it the inverse rotation"),
        (lambda q: 2 * q, "have a norm of 2; it must be 1"),
    ],
)
def test_a_contradicting_orientation_is_rejected(a1, leaning, tmp_path, change, message):
    log, quaternions = leaning
    steep = Rotation.from_euler("x", 0.3)  # so that the inverse is another
    quaternions = np.roll((Rotation.from_quat(np.roll(quaternions, -1, axis=1)) * steep).as_quat(), 1, axis=1)
    imu = replace(log.imu, acceleration_in_imu=steep.inv().apply(np.array(log.imu.acceleration_in_imu)))
    path = write_csv(tmp_path / "log.csv", with_orientation(replace(log, imu=imu), change(quaternions)))
    with pytest.raises(RecordingError, match=message):
        read_log(path, a1)


@pytest.mark.parametrize("order", [0, -1])
def test_the_quaternion_order_is_detected_on_a_robot_that_faces_forward(a1, leaning, tmp_path, order):
    """With w last, the upward direction is nearly right for half a turn about z."""
    log, quaternions = leaning
    small = Rotation.from_quat(np.roll(quaternions, -1, axis=1)).as_rotvec() * 0.15
    turned = Rotation.from_rotvec(small)
    imu = replace(log.imu, acceleration_in_imu=turned.inv().apply([0, 0, 9.81]))
    quaternions = np.roll(np.roll(turned.as_quat(), 1, axis=1), order, axis=1)
    path = write_csv(tmp_path / "log.csv", with_orientation(replace(log, imu=imu), quaternions))
    if order == 0:
        assert any("derived from the fused orientation" in finding.message for finding in read_log(path, a1).findings)
    else:
        with pytest.raises(RecordingError, match="is w the last"):
            read_log(path, a1)


def test_zeros_before_a_filter_runs_are_not_an_orientation(a1, leaning, tmp_path):
    log, quaternions = leaning
    quaternions = np.vstack([np.zeros((5, 4)), quaternions[5:]])
    read = read_log(write_csv(tmp_path / "log.csv", with_orientation(log, quaternions)), a1)
    assert len(read.recording.imu.time) == len(log.imu.time) - 5


def test_an_orientation_does_not_stand_in_for_an_accelerometer(a1, leaning, tmp_path):
    log, quaternions = leaning
    columns = columns_of(log) | with_orientation(log, quaternions)
    for axis in "xyz":
        columns[f"accelerometer.{axis}"] = np.zeros(len(columns["time"]))
    with pytest.raises(
        RecordingError, match=r"has no accelerometer\. A fused orientation gives the vertical, not the specific force"
    ):
        read_log(write_csv(tmp_path / "log.csv", columns), a1)


# --- the command line


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_off_a_terminal_the_proposal_is_the_error(a1, leaning, tmp_path, capsys):
    path = by_index(tmp_path / "log", a1, leaning[0])
    assert main(["estimate", str(path), "--robot", "unitree_a1"]) == 5
    shown = capsys.readouterr().err
    _, _, text = shown.partition("\n\n")
    (tmp_path / "columns.toml").write_text(text, encoding="utf-8")
    assert main(["estimate", str(path), "--robot", "unitree_a1", "--json"]) == 5
    error = json.loads(capsys.readouterr().out)["error"]
    assert error["type"] == "RecordingError"
    assert Columns.from_text(error["columns"], "it") == Columns.from_toml(tmp_path / "columns.toml")


def test_at_a_terminal_the_proposal_is_asked_about(a1, leaning, tmp_path, capsys, monkeypatch):
    path, kept = by_index(tmp_path / "log", a1, leaning[0]), tmp_path / "kept.toml"
    typed = [
        'gyro.x = ""',
        "",
        'gyro.x = "gyr[0]"',
        "no TOML",
        'gyro.x = "gyro[0]"',
        'gyro.y = "acc[1]"',
        'accelerometer.y = "acc[1]"',
        'gyro.y = "gyro[1]"',
        "",
        str(tmp_path / "no" / "folder"),
        str(kept),
    ]
    monkeypatch.setattr("sys.stdin", Terminal("\n".join(typed) + "\n"))
    monkeypatch.setattr("sys.stderr", errors := Terminal())
    arguments = ["estimate", str(path), "--robot", "unitree_a1", "--mass", "12.5"]
    first = main(arguments)
    shown = errors.getvalue()
    for part in (
        "Press Enter to accept", "still missing: gyro.x", "did you mean 'gyro[0]'", "your line cannot be read",
        "accelerometer.y no longer has a column; it was 'acc[1]'\nstill missing: accelerometer.y",
        "gyro.y no longer has a column; it was 'acc[1]'\nstill missing: gyro.y", "cannot write", f"saved: {kept}",
    ):  # fmt: skip
        assert part in shown, part
    assert max(map(len, shown.partition("Press Enter")[2].splitlines()[:2])) <= 80
    by_dialogue = capsys.readouterr().out
    assert main([*arguments, "--columns", str(kept)]) == first
    assert capsys.readouterr().out == by_dialogue
    assert "Segments of the log" in by_dialogue


def test_an_unfinished_dialogue_is_the_error(a1, leaning, tmp_path, monkeypatch):
    path = by_index(tmp_path / "log", a1, leaning[0])
    monkeypatch.setattr("sys.stdin", Terminal(""))
    monkeypatch.setattr("sys.stderr", errors := Terminal())
    assert main(["estimate", str(path), "--robot", "unitree_a1"]) == 5
    assert "error: the table" in errors.getvalue()
