"""Figures of the paper's sinusoidal excitations: gyroscope and joint torques, with their fits."""

from __future__ import annotations

from collections.abc import Mapping

from equipoise.conventions import AXES, FloatArray
from equipoise.figures.blocks import Block, Figure, axes, line
from equipoise.paper.equations import AxisFit
from equipoise.paper.evidence import SearchEvidence
from equipoise.result.calibration import Calibration


def excitation_blocks(result: Calibration) -> list[Block]:
    """Return two figures for each axis, and the reasons for axes without an estimate."""
    fits: Mapping[str, AxisFit] = result.evidence.fits if isinstance(result.evidence, SearchEvidence) else {}
    figures = [one for axis in AXES if axis in fits for one in _figures(fits[axis])]
    notes = [f"{axis}: {excitation.note}" for axis, excitation in result.excitations.items() if excitation.note]
    same = {excitation.note for excitation in result.excitations.values()}
    if len(notes) > 1 and len(same) == 1:
        notes = [str(same.pop())]
    return [*figures, *([tuple(notes)] if notes else [])]


def _figures(fit: AxisFit) -> list[Figure]:
    frequency = (
        f"{fit.sinusoid.frequency:.2f} Hz, the frequency of the dominant sinusoid of the gyroscope (equation 3)."
    )
    moments = f"I = {fit.inertia:.4f} kg m2, C = {fit.damping:.3f} Nm s/rad, by least squares (equation 5)."
    rate, sinusoid = fit.angular_velocity, fit.sinusoid.value(fit.time)
    return [
        _figure(fit, "gyroscope", frequency, "angular velocity [rad/s]", rate, sinusoid),
        _figure(fit, "joint torques", moments, "torque about the CoM [Nm]", fit.torque, fit.fitted_torque),
    ]


def _figure(fit: AxisFit, name: str, caption: str, label: str, measured: FloatArray, fitted: FloatArray) -> Figure:
    lines = [line(fit.time, measured, "measured", 0), line(fit.time, fitted, "fit", 1)]
    return Figure(f"Excitation about {fit.axis}: {name}", caption, lines, axes("time [s]", label), height=260)
