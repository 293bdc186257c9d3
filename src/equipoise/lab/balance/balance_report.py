"""Result of balancing: a trial per diagonal, its verdict and the design model, saved as JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from equipoise.errors import OutputError
from equipoise.json_form import fields_to_json
from equipoise.lab.balance.evaluation import BalanceTraces, Verdict
from equipoise.lab.balance.run import BalanceRun
from equipoise.recording.run_log import save_recording
from equipoise.user_file import write_file

SCHEMA = "equipoise.balance/1"


@dataclass(frozen=True, eq=False)
class BalanceTrial:
    """Trial on one diagonal.

    Attributes:
        run: run that was evaluated.
        verdict: verdict on the run.
        traces: time series that were evaluated.
        model_error: distance of the design model's CoM in front of the true one, along the horizontal normal of the
            support line at the stance [m].
        source: description of the design model's source.
    """

    run: BalanceRun
    verdict: Verdict
    traces: BalanceTraces
    model_error: float
    source: str

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {
            "model": self.source,
            "model_error": self.model_error,
            "unstable_pole": self.run.unstable_pole,
            **fields_to_json(self.verdict),
        }


@dataclass(frozen=True, eq=False)
class BalanceReport:
    """Result of all trials.

    Attributes:
        robot: name of the robot.
        sensors_corrected: true if sensor errors were corrected.
        duration: requested time on two feet [s].
        trials: trials in order.
        provenance: version, and in simulation seed, noise and payload.
    """

    robot: str
    sensors_corrected: bool
    duration: float
    trials: tuple[BalanceTrial, ...]
    provenance: Mapping[str, Any]

    @property
    def balanced(self) -> bool:
        """True if the robot balanced on every diagonal that was tried."""
        return all(trial.verdict.balanced for trial in self.trials)

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form. Lengths in m, angles in rad, torques in Nm, times in s."""
        return {
            "schema": SCHEMA,
            "robot": self.robot,
            "balanced": self.balanced,
            "sensor_errors_taken_off": self.sensors_corrected,
            "diagonals": {trial.run.diagonal: trial.to_dict() for trial in self.trials},
            "settings": {"duration": self.duration},
            "provenance": dict(self.provenance),
        }

    def to_json(self) -> str:
        """Return the JSON form as text."""
        return json.dumps(self.to_dict(), indent=2) + "\n"

    def save(self, folder: Path) -> list[Path]:
        """Write balance.json and a recording of every trial; returns their paths.

        Raises:
            OutputError: the folder cannot be written.
        """
        files = [folder / "balance.json"]
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(f"cannot write into the output folder {str(folder)!r}: {error.strerror}") from error
        write_file(files[0], self.to_json())
        for trial in self.trials:
            files.append(folder / f"balance-{trial.run.diagonal}.mcap")
            save_recording(trial.run.recording, files[-1])
        return files
