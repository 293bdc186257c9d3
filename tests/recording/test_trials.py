"""Trials: written into events and read from them, in the form of run folders; progress of a trial."""

import pytest

from equipoise.errors import RecordingError
from equipoise.recording.phases import Phase
from equipoise.recording.recording import PHASE, TRIAL, Event, ImuStream, JointStream, Recording
from equipoise.recording.trials import (
    CommandedLift,
    DesignedLift,
    ExcitationTrial,
    LiftTrial,
    PostureTrial,
    StandTrial,
    read_trial,
)
from equipoise.robot.posture import BodyPosture

# Events and phases of trials as the logs of runs hold them.
LEANING = {"roll": 0.22, "pitch": -0.22, "yaw": 0.0, "crouch": 0.12, "ahead": 0.0, "aside": 0.0}
TRIALS = {
    "paper lift": (
        {"kind": "lift", "diagonal": "FL_RR", "offset": -0.03, "lift_height": 0.016, "tilt_threshold": 0.01},
        "replant move settle rest unload lift watch lower",
        CommandedLift(diagonal="FL_RR", offset=-0.03, lift_height=0.016, tilt_threshold=0.01),
    ),
    "bayesian lift": (
        {
            "kind": "lift", "diagonal": "FR_RL", "side": 1, "turn": "yaw", "posture": LEANING, "offset": 0.0,
            "lift_height": 0.0246, "tilt_threshold": 0.01,
        },
        "move settle move settle rest unload lift watch lower replant",
        DesignedLift(
            diagonal="FR_RL", offset=0.0, lift_height=0.0246, tilt_threshold=0.01, posture=BodyPosture(**LEANING),
            side=1, turn="yaw",
        ),
    ),
    "passive lift": (
        {
            "kind": "lift", "diagonal": "FL_RR", "side": 0, "posture": LEANING, "offset": 0.0,
            "lift_height": 0.0246, "tilt_threshold": 0.01,
        },
        "move settle rest unload lift watch lower",
        DesignedLift(
            diagonal="FL_RR", offset=0.0, lift_height=0.0246, tilt_threshold=0.01, posture=BodyPosture(**LEANING), side=0
        ),
    ),
    "posture": (
        {"kind": "posture", "posture": LEANING},
        "ready settle before move settle rest",
        PostureTrial(posture=BodyPosture(**LEANING)),
    ),
    "excitation": (
        {"kind": "excitation", "amplitude": 0.05, "frequencies": {"pitch": 1.97}},
        "settle ramp excitation end",
        ExcitationTrial(frequencies={"pitch": 1.97}, amplitude=0.05),
    ),
    "excitation about all axes": (
        {"kind": "excitation", "frequencies": {"roll": 2.27, "pitch": 1.88, "yaw": 1.48}},
        "settle ramp excitation end",
        ExcitationTrial(frequencies={"roll": 2.27, "pitch": 1.88, "yaw": 1.48}),
    ),
    "stand": ({"kind": "stand"}, "move settle rest", StandTrial()),
}  # fmt: skip


def recorded(data, phases):
    """A recording with a trial event and phases 0.1 s apart."""
    time = [0.1 * index for index in range(len(phases) + 1)]
    events = [Event(0.0, TRIAL, data)] if data is not None else []
    events += [Event(start, PHASE, {"name": name}) for start, name in zip(time, phases, strict=False)]
    rows = [[0.0]] * len(time)
    return Recording(("a",), JointStream(time, rows), ImuStream(time, [[0.0] * 3] * len(time), [[0.0] * 3] * len(time)),
                     None, tuple(events))  # fmt: skip


@pytest.fixture(params=TRIALS)
def logged(request):
    return TRIALS[request.param]


def test_a_trial_is_read_from_its_event(logged):
    data, phases, trial = logged
    recording = recorded(data, phases.split())
    assert type(recording.trial) is type(trial)
    assert recording.trial == trial
    assert recording.complete
    assert not recording.refused


def test_a_trial_is_written_as_its_event(logged):
    """The form must be exact: a resumed run compares its events with those recorded."""
    data, _, trial = logged
    assert Event(0.0, TRIAL, trial.to_data()) == Event(0.0, TRIAL, data)


@pytest.mark.parametrize(
    ("kind", "phases", "state"),
    [
        ("paper lift", "replant move settle", "refused"),
        ("paper lift", "replant move settle rest", "refused"),
        ("paper lift", "replant move settle rest unload", "interrupted"),
        ("paper lift", "replant move settle rest unload lift watch", "interrupted"),
        ("paper lift", "replant move settle rest unload lift watch lower", "complete"),
        ("posture", "ready settle before", "refused"),
        ("posture", "ready settle before move settle", "interrupted"),
        ("posture", "ready settle before move settle rest", "complete"),
        ("excitation", "settle", "refused"),
        ("excitation", "settle ramp excitation", "interrupted"),
        ("excitation", "settle ramp excitation end", "complete"),
        ("stand", "move settle", "interrupted"),
        ("stand", "rest", "complete"),
    ],
)
def test_phases_determine_the_progress_of_a_trial(kind, phases, state):
    recording = recorded(TRIALS[kind][0], phases.split())
    progress = {(True, False): "complete", (False, True): "refused", (False, False): "interrupted"}
    assert progress[recording.complete, recording.refused] == state


@pytest.mark.parametrize("data", [None, {"kind": "shake", "size": 1.0}, {}])
def test_foreign_events_are_not_trials(data):
    recording = recorded(data, [Phase.REST, Phase.UNLOAD, Phase.LOWER, Phase.END])
    assert recording.trial is None
    assert (recording.complete, recording.refused) == (False, False)


@pytest.mark.parametrize(
    "trial",
    [
        LiftTrial(diagonal="FL_RR", found_at=12.5),
        PostureTrial(posture=None, found_at=3.0),
        ExcitationTrial(frequencies={}, found_at=1.0),
        StandTrial(found_at=0.0),
    ],
)
def test_a_trial_in_a_log_is_read_as_written(trial):
    found = read_trial(Event(0.0, TRIAL, trial.to_data()).data)
    assert type(found) is type(trial)
    assert found == trial


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        ({"kind": "lift"}, "it lacks 'diagonal'"),
        ({"kind": "lift", "diagonal": "FL_RL"}, "'FL_RL' is not a diagonal"),
        (
            {"kind": "lift", "diagonal": "FL_RR", "offset": 0.0},
            "it lacks 'lift_height'",
        ),
        ({**TRIALS["paper lift"][0], "offset": "far"}, "offset is 'far'; it must be a number"),
        ({**TRIALS["bayesian lift"][0], "turn": "about"}, "'about' is not a turn; those are roll, pitch, yaw"),
        ({**TRIALS["bayesian lift"][0], "posture": 3}, "posture is 3; it must be a table"),
        ({"kind": "excitation", "frequencies": {"x": 2.0}, "amplitude": 0.1}, "no axes are called x"),
        ({"kind": "posture", "posture": {"roll": None}}, "posture.roll is None; it must be a number"),
    ],
)
def test_a_damaged_trial_raises(data, reason):
    with pytest.raises(RecordingError) as caught:
        _ = recorded(data, []).trial
    assert f"the recording's trial {data} is damaged: {reason}" in str(caught.value)
    assert str(caught.value).endswith("; leave the recording out")
