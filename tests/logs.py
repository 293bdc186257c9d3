"""Recordings and logs that tests write and read."""

from dataclasses import replace

import numpy as np

from equipoise.recording.recording import CommandStream, Event, ImuStream, JointStream, Recording
from equipoise.recording.run_log import RunLog

NAMES = ("a", "β")


def piece(start=0.0, count=10, events=(), velocity=True, torque=True, commands=True, names=NAMES, seed=0):
    """Samples 10 ms apart; the IMU has a clock of its own."""
    time = start + 0.01 * np.arange(count)
    values = np.random.default_rng([seed, int(1000 * start)]).standard_normal((4, count, len(names)))
    rates = np.random.default_rng([seed, 1, int(1000 * start)]).standard_normal((2, count, 3))
    return Recording(
        names,
        JointStream(time, values[0], values[1] if velocity else None, values[2] if torque else None),
        ImuStream(time + 0.003, *rates),
        CommandStream(time[: count // 2], values[3][: count // 2]) if commands else None,
        tuple(events),
    )


def trial_event(time, kind="lift", **about):
    return Event(time, "trial", {"kind": kind, **about})


def whole(trial, *pieces):
    """Recording of a trial, as the robot's side makes it."""
    return replace(Recording.concatenate(pieces), trial_id=trial)


def bits(recording):
    """Contents of a recording, with exact numbers."""
    found = {"joint_names": recording.joint_names, "events": recording.events}
    for name in ("joints", "imu", "commands"):
        stream = getattr(recording, name)
        if stream is not None:
            found |= {f"{name}.{key}": None if a is None else (a.shape, a.tobytes()) for key, a in vars(stream).items()}
    return found


def write_run(path, trials=3, close=True):
    """A log as a run writes it: up, trials of two motions each in pieces, down. Returns the trials."""
    log, kept, time = RunLog(path), [], 0.0

    def play(*pieces, trial=None):
        log.begin(99, trial)
        for one in pieces:
            log.add(one)

    play(piece(time))
    for trial in range(trials):
        time = 1.0 + trial
        first = [piece(time, events=[trial_event(time, number=trial)]), piece(time + 0.1)]
        second = [piece(time + 0.2, torque=trial != 1), piece(time + 0.3, events=[Event(time + 0.35, "note")])]
        play(*first, trial=trial)
        play(*second, trial=trial)
        kept.append(whole(trial, *first, *second))
        log.keep(kept[-1])
    play(piece(time + 1))
    if close:
        log.close()
    else:
        kill(log)
    return kept


def kill(log):
    """Cut a log as if its process had been killed."""
    log._file.close()
