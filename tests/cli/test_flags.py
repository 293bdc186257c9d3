"""Flags of every verb, in the form that help shows."""

import dataclasses
import functools
import re

import pytest
from commands import fails

from equipoise import RunFolder, cli
from equipoise.cli import VERBS, find_verb, main
from equipoise.method.table import METHODS, method_named

# Verbs, and those with other flags because of one that is given; in front of them what a verb does not go without.
SHAPES = {
    **{verb: [verb] for verb in VERBS if verb not in ("robots", "platforms")},
    **{verb: [verb, "RUN"] for verb in ("estimate", "diagnose", "view")},
    "payload": ["payload", "unitree_a1"],
    **{f"lab {verb}": ["lab", verb] for verb in ("balance", "monte-carlo", "reproduce")},
    "lab validate": ["lab", "validate", "RUN"],
    **{f"lab emulate {protocol}": ["lab", "emulate", protocol] for protocol in ("unitree-dds", "unitree-udp")},
    "estimate a log": ["estimate", "log.mcap", "--robot", "unitree_a1"],
    "compare": ["compare", "RUN", "RUN"],
    **{f"calibrate {way}": ["calibrate", *way.split()] for way in (
        "--method paper", "--method static", "--method motors", "--parameters base,motors")},
    "calibrate on a robot": ["calibrate", "--platform", "unitree-go2"],
    "payload on a robot": ["payload", "unitree_a1", "--platform", "unitree-go2"],
    "lab monte-carlo of paper": ["lab", "monte-carlo", "--methods", "paper"],
}  # fmt: skip


def named(words):
    """Return the name of a verb with its group, and the words that follow."""
    count = 2 if words[0] == "lab" else 1
    return " ".join(words[:count]), words[count:]


TABLES = {"estimate", "diagnose", "payload", "view", "validate"}  # verbs that take further tables: one more word is one
NUMBERS = {
    "X Y Z": "0.01 -0.02 3e-2",
    "KG KG": "13 14",
    "ROLL PITCH YAW": "0.1 -0.2 1.5",
    "NAME LO HI": "FL_hip_joint -0.5 0.5",
    "HERTZ": "1.5",
    **dict.fromkeys(("METRES", "RADIANS", "NUMBER", "FLOAT", "FRACTION", "SECONDS"), "0.1"),
    **dict.fromkeys(("N", "INT", "PORT", "KG"), "12"),
}
WORDS = {
    "TIME": "60s",
    "NAME=ANGLE": "FL_hip_joint=-0.1",
    "NAME=FRAME": "FL=FL_foot",
    "NAME": "trunk",
    "M,X,Y,Z": "1,0.05,-0.02,0.08",
    "random|none|M,X,Y,Z": "random",
    "NAME=SIZE,NAME": "springs=3000,cable",
    "NAME,NAME": "springs,cable",
    "KEY=VALUE": "interface=eth0",
    "NAMES": "base",
    "WORDS": "identified,checks",
    "PLATFORM": "mujoco",
    "ROBOT": "unitree_a1",
    "FORMAT": "urdf",
    "TOPIC": "/joint_states",
    "STR": "localhost",
    "LENGTH": "5mm",
    "tcp://HOST:PORT": "tcp://192.168.1.2:8786",
}
FILES = {"PATH": "settings.toml", "FILE": "settings.toml", "RUN": "run", "FILE.rrd": "run.rrd", "MODEL": "run"}
OWN = {
    "--mass-std": "0.1",
    "--methods": "static,paper",
    "--disable-effect": "joint_offset,imu_tilt",  # not those that --enable-effect names
    "--only-effects": "joint_offset,imu_tilt",
    "--upper": "0.2",  # above --lower
    "--t-thres": "2s",
}
OTHERS = {  # which a flag needs; it is given without further ones
    "--mass-std": ["--mass", "12"],
    "--confirm-mass": ["--mass", "12"],
    "--prior-run": [],  # whose settings exclude others
}
WEIGHED = {flag: ["--mass", "12"] for flag in ("--confirm-mass", "--mass-std")}  # the same of `weigh`
OF_LOGS = {"--method": ["--robot", "unitree_a1"]}  # a run has a method
NEEDED = {"payload": OTHERS | WEIGHED, **dict.fromkeys(("estimate", "diagnose"), OTHERS | OF_LOGS)}
ALONE = ("--resume", "--method", "--parameters", "--methods", "--platform")  # not with others of their kind
LINE = re.compile(r"^  (?:(-\w), )?(--[a-z][\w-]*)((?: \S+)*?)(?:  .*)?$", re.MULTILINE)


@pytest.fixture(scope="module")
def folder(a1, bayesian_run, tmp_path_factory):
    """Folder with a run and an empty file of settings."""
    folder = tmp_path_factory.mktemp("user")
    with RunFolder.create(folder / "run", a1, bayesian_run.settings, {"time": "2026-01-01T00:00:00+00:00"}) as run:
        run.save(bayesian_run.result.with_provenance(**run.provenance))
    (folder / "settings.toml").touch()
    return folder


@pytest.fixture
def words(shape, folder, monkeypatch):
    """Verb with its required arguments."""
    monkeypatch.chdir(folder)
    monkeypatch.setenv("COLUMNS", "80")
    return ["run" if word == "RUN" else word for word in SHAPES[shape]]


@pytest.fixture
def read(monkeypatch):
    """Settings of the last called verb; the verbs only read their settings."""
    seen = {}

    def found(name, arguments=()):
        verb = find_verb(name, arguments)

        @functools.wraps(verb)
        def reading(*positional, **given):
            seen.clear()
            seen.update(given)
            return 0

        return reading

    monkeypatch.setattr(cli, "find_verb", found)
    return seen


def shown_flags(words, capsys):
    """Return (flag, metavar) of each line of a verb's help; switches have an empty metavar."""
    assert main([*words, "--help"]) == 0
    return [(name, metavar.strip()) for _, name, metavar in LINE.findall(capsys.readouterr().out) if name != "--help"]


@pytest.fixture(scope="module")
def first_shape():
    """Return an empty table: the shape with which a flag is tried first, among those that take further tables or do not."""
    return {}


def values_of(flag, metavar):
    """Return valid values for a flag; each inner list is for one command."""
    if flag in OWN:
        return [[OWN[flag]]]
    if metavar.startswith("{"):
        return [[choice] for choice in metavar.strip("{},").split(",")]  # a long list goes on in the next line
    return [({"": ""} | NUMBERS | WORDS | FILES)[metavar].split()]


def commands_of(words, shown):
    """Return commands that give each flag each of its values: together, but for flags that exclude or need others."""
    needed = NEEDED.get(words[0], OTHERS)
    values = {flag: values_of(flag, metavar) for flag, metavar in shown}
    commands = [
        [*needed.get(flag, ()), flag, *value]
        for flag in values
        if flag in {*ALONE, *needed} and not (flag in ALONE and any(word.startswith("--") for word in words))
        for value in values[flag]
    ]
    together = {flag: values[flag] for flag in values if flag not in {*ALONE, *needed}}
    for number in range(max(map(len, together.values()), default=0)):
        given = ([flag, *choices[number % len(choices)]] for flag, choices in together.items())
        commands.append([word for one in given for word in one])
    return commands


@pytest.mark.parametrize("shape", SHAPES)
def test_every_flag_can_be_typed_as_its_help_shows_it(words, read, capsys):
    for command in commands_of(words, shown_flags(words, capsys)):
        assert main([*words, *command]) == 0, (command, capsys.readouterr().err)
        assert read


@pytest.mark.parametrize("method", [*METHODS])
def test_a_run_of_any_method_is_estimated_again_without_a_warning(method, a1, tmp_path, read, capsys):
    with RunFolder.create(tmp_path / "run", a1, method_named(method)(), {}):
        assert main(["estimate", str(tmp_path / "run")]) == 0
    assert read
    assert not capsys.readouterr().err


@pytest.mark.parametrize("method", [*METHODS])
def test_help_shows_every_setting_of_a_method(method, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "80")
    shown = {flag for flag, _ in shown_flags(["calibrate", "--method", method], capsys)}
    for field in dataclasses.fields(method_named(method)):
        nested = dataclasses.is_dataclass(field.default_factory) and "file" not in field.metadata
        inner = [setting.name for setting in dataclasses.fields(field.default_factory)] if nested else []
        below = field.metadata.get("prefix", f"{field.name}_")
        hidden = not field.metadata.get("flag", True) or (nested and below is None)
        for name in [] if hidden else [f"{below}{name}" for name in inner] if nested else [field.name]:
            assert shown & {f"--{name.replace('_', '-')}", f"--no-{name.replace('_', '-')}"}, name


@pytest.mark.parametrize("shape", SHAPES)
def test_errors_of_numbers_name_the_flag(shape, words, read, capsys, first_shape):
    for flag, metavar in shown_flags(words, capsys):
        if metavar in NUMBERS and first_shape.setdefault((flag, metavar, bool(TABLES & {*words})), shape) == shape:
            right = NUMBERS[metavar].split()
            too_many = [] if TABLES & {*words} else [[*right, "7"]]
            for wrong in (right[:-1], *too_many, [*right[:-1], "seven"]):
                assert_refused([*words, flag, *wrong], flag, capsys)


@pytest.mark.parametrize("words", [
    "calibrate --duration", "record --duration", "doctor --duration", "lab balance --com 0,0 --duration",
    "payload unitree_a1 --duration",
    "view run --from", "view run --until", "lab monte-carlo --trial-limit",
])  # fmt: skip
def test_errors_of_times_name_the_flag(words, folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    assert_refused([*words.split(), "soon"], words.split()[-1], capsys)


def assert_refused(words, flag, capsys):
    assert main(words) == 2, words
    message = capsys.readouterr().err
    assert flag in message, words
    assert "Traceback" not in message


@pytest.mark.parametrize(("shape", "flags", "name", "value"), [
    ("plan", "--imu-position 0.1 -0.2 0.3", "imu_position", (0.1, -0.2, 0.3)),
    ("plan", "--imu-rpy 0 -1e-1 3.14", "imu_rpy", (0.0, -0.1, 3.14)),
    ("plan", "--joint-limits a -1 2 --joint-limits b 0 0.5", "joint_limits", {"a": (-1.0, 2.0), "b": (0.0, 0.5)}),
    ("plan", "--foot-frames FL=toe --foot-frames RR=heel", "foot_frames", {"FL": "toe", "RR": "heel"}),
    ("plan", "--locked-joints arm=-0.1", "locked_joints", {"arm": -0.1}),
])  # fmt: skip
def test_flags_of_several_values_reach_the_description(words, read, flags, name, value):
    assert main([*words, *flags.split()]) == 0
    assert getattr(read["description"], name) == value


@pytest.mark.parametrize(("flags", "message"), [
    ("--imu-position 0 0 0.1 5", "--imu-position takes 3 values, not '0 0 0.1 5'"),
    ("--kp 100 200", "--kp takes one number, not '100 200'"),
    ("--foot-frames FL", "--foot-frames FL is not NAME=FRAME"),
    ("--stance FL_hip_joint=left", "--stance FL_hip_joint=left is not NAME=ANGLE, in radians"),
])  # fmt: skip
def test_wrong_values_raise_one_clear_error(capsys, flags, message):
    assert message in fails(capsys, 2, "audit", "unitree_a1", *flags.split())


@pytest.mark.parametrize("protocol", ["unitree-dds", "unitree-udp", "ros2"])
def test_help_of_an_emulator_is_that_of_other_verbs(protocol, read, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "80")
    assert main(["lab", "emulate", protocol, "--help"]) == 0
    shown = capsys.readouterr().out
    assert "emulator." not in shown
    assert not re.search(r"\{None\}|INT|FLOAT|--\w+ STR|default: (True|False|None|)\)", shown)
    assert main(["lab", "emulate", protocol]) == 0
    assert read["options"] == type(read["options"])()


@pytest.mark.parametrize("method", ["bayesian", "static"])
def test_examples_of_estimate_suit_the_method_of_the_help(method, capsys):
    assert main(["estimate", "log.jsonl", "--robot", "go2", "--method", method, "--help"]) == 0
    example = capsys.readouterr().out.split("Example: ")[1]
    (weighed,) = [line for line in example.splitlines() if "equipoise estimate" in line and "--mass" in line]
    assert "--method bayesian --mass" in weighed
    assert ("--mass-std" in example) == (method == "bayesian")


def test_flags_of_an_emulator_reach_its_settings(read):
    robot = "--payload 1,0,0,0.1 --enable-effect cable --start lying --duration 2min"
    assert main(["lab", "emulate", "unitree-udp", *robot.split(), "--tick", "2ms", "--loss", "0.1"]) == 2
    assert main(["lab", "emulate", "unitree-udp", *robot.split(), "--tick", "0.002s", "--loss", "0.1"]) == 0
    options = read["options"]
    assert (options.tick, options.loss, options.reorder) == (0.002, 0.1, 0.0)
    assert (options.payload, options.enable_effect, options.start, options.duration) == (
        "1,0,0,0.1", ("cable",), "lying", 120.0
    )  # fmt: skip


def test_a_folder_may_have_a_number_as_its_name(folder, monkeypatch, read):
    monkeypatch.chdir(folder)
    (folder / "7").mkdir(exist_ok=True)
    assert main(["export", "--seed", "3", "7"]) == 0
    assert dataclasses.is_dataclass(read["output"])
