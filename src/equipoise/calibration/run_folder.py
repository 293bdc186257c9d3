"""Run folder: robot model, settings, recordings and result of a run on disk.

run.json            robot, settings, provenance
model.xml           robot model (URDF or MJCF, cleaned)
recording_0.mcap    samples and commands, written during the run; recording_1.mcap after it was resumed, ...
ending.txt          how a real robot was lowered at the end
metadata.yaml       rosbag2 metadata of the recordings, once the run is over
truth.json          ground truth (simulation only)
calibration.json    result
posterior.json      posterior for later runs of this robot, if the method provides it
prior_run.json      posterior of the prior run, if there is one
report.html         report
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import shutil
import warnings
from collections import deque
from collections.abc import Mapping
from contextlib import AbstractContextManager, nullcontext, suppress
from pathlib import Path
from typing import Any

import numpy as np

from equipoise.calibration.run_header import HEADER, REMEDY, RESULT, SCHEMA, damaged, read_header, read_json
from equipoise.errors import ModelWarning, OutputError, RecordingError, SettingsError, reason
from equipoise.experiments.response_test import ResponseTest
from equipoise.json_form import fields_to_json, from_json, to_json
from equipoise.method.method import Method
from equipoise.method.table import method_from_dict
from equipoise.recording.mcap_reader import was_closed
from equipoise.recording.recording import Recording
from equipoise.recording.rosbag2 import METADATA, write_metadata
from equipoise.recording.run_log import RunLog, resume_log
from equipoise.recording.run_log_reader import LogContent, log_file, log_files, read_log
from equipoise.result.body import BODIES
from equipoise.result.calibration import Calibration, PartsTruth
from equipoise.robot.description import RobotDescription
from equipoise.robot.inertial import RobotInertia
from equipoise.robot.model import RobotModel
from equipoise.robot.source import ModelSource
from equipoise.user_file import read_text, remove_partial_files, typed, write_file

POSTERIOR = "posterior.json"
_MODEL, _TRUTH = "model.xml", "truth.json"
_RESPONSE = "response_test"  # key in the provenance


class RunFolder(AbstractContextManager["RunFolder"]):
    """Run on disk, made by `create`, `open` or `resume`.

    A created or resumed run is open for writing: use it as a context manager, or close it.

    Attributes:
        path: path of the folder.
    """

    def __init__(self, path: Path, header: Mapping[str, Any], log: RunLog | None = None) -> None:
        self.path = path
        self._header: Mapping[str, Any] = header
        self._log = log
        self._replayed = deque[Recording]()  # stored recordings that a resumed routine repeats first

    @classmethod
    def create(cls, path: str | Path, robot: RobotModel, method: Method, provenance: Mapping[str, Any]) -> RunFolder:
        """Create a new run.

        Raises:
            OutputError: the folder is not empty, or cannot be written.
        """
        path = Path(path)
        header = {
            "schema": SCHEMA,
            "robot": robot.name,
            "model": _model_table(robot.source),
            "description": to_json(robot.description),
            "settings": method.to_dict(),
            **({"attachments": [*method.attachments()]} if method.attachments() else {}),
            "provenance": dict(provenance),
        }
        try:
            if path.is_dir() and any(path.iterdir()):
                holds = "another run" if (path / HEADER).exists() else "other files"
                raise OutputError(f"the output folder {str(path)!r} holds {holds}; name a new one with --out")
            path.mkdir(parents=True, exist_ok=True)
            write_file(path / _MODEL, robot.source.xml)
            for name, table in method.attachments().items():
                write_file(path / f"{name}.json", json.dumps(table) + "\n")
            log = RunLog(log_file(path, 0))
            write_file(path / HEADER, json.dumps(header, indent=2) + "\n")  # last, so that a header implies the rest
        except OutputError:
            raise
        except OSError as error:
            raise OutputError(
                f"cannot write into the output folder {str(path)!r}: {error.strerror}; name another folder with --out"
            ) from error
        return cls(path, header, log)

    def discard(self) -> None:
        """Remove the folder of a run that was rejected before its first trial."""
        shutil.rmtree(self.path, ignore_errors=True)

    @classmethod
    def open(cls, path: str | Path) -> RunFolder:
        """Open an existing run; raises RecordingError if the folder is not a run."""
        path = Path(path)
        return cls(path, read_header(path))

    @classmethod
    def resume(cls, path: str | Path, repeats: bool) -> tuple[RunFolder, LogContent]:
        """Open an interrupted run to resume it after its last complete recording; return it with its log's content.

        Args:
            path: path of the folder.
            repeats: True if later motions will be repeated exactly, as in simulation. False to keep them in the log, as
                those of a real robot.

        Raises:
            RecordingError: the folder is not a run, or its log is damaged.
            OutputError: the run cannot be written, or another process writes it.
        """
        folder = cls.open(path)
        folder._log, content = resume_log(folder.path, repeats)
        (folder.path / METADATA).unlink(missing_ok=True)  # the recordings will change
        remove_partial_files(folder.path)
        folder._replayed = deque(content.recordings)
        return folder, content

    @property
    def log(self) -> RunLog:
        """Log that the platform writes to; raises OutputError if the run is not open for writing."""
        if self._log is None:
            raise OutputError(f"the run {str(self.path)!r} is not open for writing; create a new one, or resume it")
        return self._log

    @property
    def complete(self) -> bool:
        """True if the run has a result."""
        return (self.path / RESULT).exists()

    @property
    def cut(self) -> bool:
        """True if the recording lost its end after the run had a result, as in an incomplete copy."""
        return self.complete and self._ends_early

    @property
    def _ends_early(self) -> bool:
        return self._log is None and not was_closed(log_files(self.path)[-1])

    @property
    def provenance(self) -> Mapping[str, Any]:
        """Time, platform and settings of the run."""
        return self._header["provenance"]

    def save_response(self, found: ResponseTest) -> None:
        """Store the result of the response test, with the IMU's orientation in this run; a resumed run keeps its first one.

        Raises:
            RecordingError: the orientation differs from that of the recorded trials.
        """
        if found.uses_measurement and self._replayed:
            raise RecordingError(
                f"{found.orientation}, {np.degrees(found.angle):.1f} deg from the orientation of the trials in the run "
                f"{str(self.path)!r}; the IMU may have moved: start a new run"
            )
        if found.uses_measurement or _RESPONSE not in self.provenance:
            self._header = {**self._header, "provenance": {**self.provenance, _RESPONSE: to_json(found)}}
            write_file(self.path / HEADER, json.dumps(self._header, indent=2) + "\n")

    def keep(self, recording: Recording) -> None:
        """Store the next recording in the log; in a resumed run, first compare it with the stored ones.

        Raises:
            RecordingError: a resumed run repeats a recording with a difference.
        """
        if not self._replayed:
            self.log.keep(recording)
        elif not recording.broken and not recording.equals(self._replayed.popleft()):
            raise RecordingError(
                f"the run {str(self.path)!r} does not reproduce its recordings; resume it with the version of equipoise "
                "that made it"
            )

    def recordings(self) -> list[Recording]:
        """Return all complete recordings in order; warns if the log ends in the middle."""
        recordings = list(self.read().recordings)
        if self._ends_early:
            warnings.warn(self._end_warning(), stacklevel=2)
        return recordings

    def read(self) -> LogContent:
        """Return the content of the log."""
        return read_log(self.path)

    def _end_warning(self) -> str:
        """Return the warning about a log that was not closed."""
        ends = f"the recording of the run {str(self.path)!r} ends in the middle"
        if self.cut:
            return (
                f"{ends}: it was cut, and may lack motions that the stored {RESULT} is estimated from; copy "
                f"{log_files(self.path)[-1].name} again from a complete run folder"
            )
        return f"{ends}: the run was killed, or is not over; resume it: equipoise calibrate --resume {typed(self.path)}"

    def close(self) -> None:
        """Close the log; may be called twice."""
        if self._log is None:
            return
        log, self._log = self._log, None
        log.close()
        write_metadata(self.path, [file for file in log_files(self.path) if file.exists()])

    def __exit__(self, *exception: object) -> None:
        with suppress(OutputError) if exception[0] else nullcontext():  # the first error is the cause
            self.close()

    def robot(self) -> RobotModel:
        """Return the robot model of the run; repairs of its model file are not reported again."""
        model = self._header["model"]
        description: dict[str, Any] = dict(self._header["description"])
        if (response := self.provenance.get(_RESPONSE)) and response["uses_measurement"]:
            description["imu_rpy"] = response["measured_rpy"]
        try:
            xml = read_text(self.path / _MODEL)
            if _sha256(xml) != model["xml_sha256"]:
                raise RecordingError(
                    f"the {_MODEL} of the run {str(self.path)!r} was changed after the recording; {REMEDY}"
                )
            own = {name: value for name, value in model.items() if name != "xml_sha256"}
            source = from_json(ModelSource, {**own, "path": Path(own["path"]), "xml": xml})
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", ModelWarning)
                return RobotModel.from_source(source, self._header["robot"], RobotDescription.from_dict(description))
        except OSError as error:
            raise damaged(self.path, f"its {_MODEL} cannot be read ({error.strerror})") from error
        except (KeyError, TypeError, ValueError) as error:
            raise damaged(self.path, f"its {HEADER} and {_MODEL} do not define a robot ({reason(error)})") from error

    def method(self) -> Method:
        """Return the method of the run; raises MissingDependencyError if its package cannot be used."""
        try:
            return method_from_dict({**self._header["settings"], **self._attached()})
        except (AttributeError, TypeError, SettingsError) as error:
            raise RecordingError(
                f"the settings of run {str(self.path)!r} are damaged: {reason(error)} (in its {HEADER}); {REMEDY}; "
                "or, if another version of equipoise made the run, estimate it with that version"
            ) from error

    def _attached(self) -> dict[str, Any]:
        """Return the settings that are stored in files of their own."""
        return {name: self._read_table(f"{name}.json") for name in self._header.get("attachments", ())}

    def save_truth(self, truth: RobotInertia, of_parts: PartsTruth | None = None) -> None:
        """Store a simulated robot's ground truth; only `estimate` reads it, after estimating."""
        table = {**to_json(truth), **(of_parts or {})}
        write_file(self.path / _TRUTH, json.dumps(table, indent=2) + "\n")

    def estimate(self, method: Method | None = None) -> Calibration:
        """Estimate again from the recordings, without a robot or a simulator; default: the method of the run."""
        from equipoise.calibration.routine import estimate  # noqa: PLC0415 - a stored result needs no estimator

        calibration = estimate(self.robot(), self.recordings(), method or self.method())
        calibration = calibration.with_provenance(**self._header["provenance"])
        truth = self.truth()
        if truth is None:
            return calibration
        table = self._read_table(_TRUTH)
        of_parts: PartsTruth = {name: table.get(name) or {} for name in ("motors", "links")}
        return calibration.with_truth(truth).with_truth_of_parts(of_parts)

    def truth(self) -> RobotInertia | None:
        """Return a simulated robot's ground truth, for comparison with an estimate; None for a real robot."""
        if not (self.path / _TRUTH).exists():
            return None
        try:
            table = self._read_table(_TRUTH)
            return from_json(RobotInertia, {name: table[name] for name in BODIES})
        except (KeyError, TypeError, ValueError) as error:
            raise damaged(self.path, f"its {_TRUTH} is not a ground truth ({reason(error)})") from error

    def _read_table(self, name: str) -> dict[str, Any]:
        return read_json(self.path / name, f"the run {str(self.path)!r} is damaged", f"; {REMEDY}")

    def result(self) -> Calibration:
        """Return the saved result with the robot's model; raises RecordingError if the run has none."""
        if not self.complete:
            raise RecordingError(
                f"the run {str(self.path)!r} has no result; resume it: equipoise calibrate --resume {typed(self.path)}"
            )
        return dataclasses.replace(Calibration.load(self.path / RESULT), robot_model=self.robot())

    def shown(self) -> Calibration:
        """Return the result with its evidence, for display; if the recordings were cut, warn and return it without."""
        if not self.cut:
            return self.estimate()
        warnings.warn(self._end_warning(), stacklevel=2)
        return self.result()

    def save(self, calibration: Calibration) -> Path:
        """Write the result, and the posterior for later runs."""
        self.save_posterior(calibration)
        calibration.save(self.path / RESULT)
        return self.path / RESULT

    def save_posterior(self, calibration: Calibration) -> None:
        """Write the posterior for later runs of this robot, if the result has evidence and the method provides it."""
        kept = None if calibration.evidence is None else calibration.evidence.keepsake(calibration.settings)
        if kept is not None:
            write_file(self.path / POSTERIOR, json.dumps(kept) + "\n")


def _model_table(source: ModelSource) -> dict[str, Any]:
    """Return the JSON form of the model's source without the XML, which has its own file."""
    table = {**fields_to_json(source), "path": str(source.path), "xml_sha256": _sha256(source.xml)}
    del table["xml"]
    return table


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
