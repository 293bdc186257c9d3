"""Estimates of the paper: planar CoM from two support lines (Algorithm 2), I and C from excitations (equations 2 to 5)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from equipoise.conventions import AXES, Axis, FloatArray
from equipoise.errors import RecordingError
from equipoise.experiments.posture import stance_line
from equipoise.experiments.tilt import SupportPlane
from equipoise.recording.phases import Phase
from equipoise.recording.recording import Recording
from equipoise.robot.kinematics import Kinematics, feet_and_forces
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance

_TORQUE_RATE = 40.0  # [Hz], well above the few Hz of an excitation


@dataclass(frozen=True)
class Sinusoid:
    """Angular velocity omega_j(t) = a sin(2 pi F t + phi) (equation 3).

    Attributes:
        frequency: frequency F [Hz].
        amplitude: amplitude a of the angular velocity [rad/s].
        phase: phase phi at t = 0 [rad].
    """

    frequency: float
    amplitude: float
    phase: float

    def value(self, time: FloatArray) -> FloatArray:
        """Evaluate equation 3 [rad/s]."""
        return self.amplitude * np.sin(2 * np.pi * self.frequency * time + self.phase)

    def derivative(self, time: FloatArray) -> FloatArray:
        """Evaluate equation 4, the analytic derivative [rad/s2]."""
        rate = 2 * np.pi * self.frequency
        return self.amplitude * rate * np.cos(rate * time + self.phase)


@dataclass(frozen=True, eq=False)
class AxisFit:
    """Inertia and damping fitted to one excitation.

    Attributes:
        axis: base axis of the excitation: "roll", "pitch" or "yaw".
        inertia: moment of inertia I_j about the axis [kg m2].
        damping: damping C_j about the axis [Nm s/rad].
        sinusoid: dominant sinusoid of the angular velocity about the axis.
        time: (n,) times of the samples below [s].
        angular_velocity: (n,) measured angular velocity of the base about the axis [rad/s].
        torque: (n,) torque about the axis through the CoM, mean subtracted [Nm].
        fitted_torque: (n,) fitted torque I d(omega)/dt + C omega [Nm].
    """

    axis: Axis
    inertia: float
    damping: float
    sinusoid: Sinusoid
    time: FloatArray
    angular_velocity: FloatArray
    torque: FloatArray
    fitted_torque: FloatArray


def find_intersection(planes: Sequence[SupportPlane], com_height: float) -> FloatArray:
    """Return the crossing (x_c, y_c) of two support planes at a height in the base frame [m] (Algorithm 2, line 5).

    With commanded feet and gravity along the base's z axis, these are the paper's two lines and the height has no effect.
    With measured gravity the planes lean by a fraction of a degree, and the effect is small.

    Args:
        planes: support planes in the base frame, one per diagonal.
        com_height: height z of the nominal model's CoM in the base frame [m].
    """
    normals = np.array([plane.normal for plane in planes])
    levels = np.array([plane.normal @ plane.point for plane in planes]) - normals[:, 2] * com_height
    return np.asarray(np.linalg.solve(normals[:, :2], levels), dtype=float)


def commanded_plane(stance: Stance, diagonal: str, offset: float) -> SupportPlane:
    """Return the support plane through commanded feet (r_hat of Algorithm 1) under a level base.

    Args:
        offset: shift of the support line from the nominal stance along the base's x axis [m].
    """
    _, normal, middle = stance_line(stance, diagonal)
    return SupportPlane(middle + [offset, 0.0, 0.0], normal)


def dominant_sinusoid(time: FloatArray, signal: FloatArray) -> Sinusoid:
    """Compute frequency, amplitude and phase of a signal's dominant sinusoid.

    The search starts at the strongest bin of the Fast Fourier Transform. A bin is as wide as one over the signal's duration,
    which is too coarse for the phase.
    Least squares (sine, cosine and mean) refine the frequency within one bin of the start.

    Args:
        time: (n,) evenly spaced times [s].
        signal: (n,) samples at these times.

    Raises:
        RecordingError: fewer than eight samples, or no oscillation.
    """
    if len(time) < 8:
        raise RecordingError(f"the excitation has {len(time)} samples; its frequency needs at least 8")
    step = float(np.mean(np.diff(time)))
    spectrum = np.abs(np.fft.rfft((signal - signal.mean()) * np.hanning(len(signal))))
    bins = np.fft.rfftfreq(len(signal), step)
    peak = 1 + int(np.argmax(spectrum[1:]))
    if not spectrum[peak] > 0:
        raise RecordingError("the base did not oscillate")
    from scipy.optimize import minimize_scalar  # noqa: PLC0415 - a third of a second to import

    found = minimize_scalar(
        lambda frequency: _sine_fit(time, signal, frequency)[1],
        bounds=(bins[peak] - bins[1], bins[peak] + bins[1]),
        method="bounded",
        options={"xatol": 1e-6 * bins[1]},
    )
    frequency = float(found.x)
    (sine, cosine, _), _ = _sine_fit(time, signal, frequency)
    return Sinusoid(frequency, float(np.hypot(sine, cosine)), float(np.arctan2(cosine, sine)))


def _sine_fit(time: FloatArray, signal: FloatArray, frequency: float) -> tuple[FloatArray, float]:
    angle = 2 * np.pi * frequency * time
    basis = np.column_stack([np.sin(angle), np.cos(angle), np.ones_like(time)])
    coefficients = np.asarray(np.linalg.lstsq(basis, signal, rcond=None)[0], dtype=float)
    residual = signal - basis @ coefficients
    return coefficients, float(residual @ residual)


def fit_axis(
    robot: RobotModel, recording: Recording, axis: Axis, com_at_stance: FloatArray, stance: FloatArray
) -> AxisFit:
    """Fit I_j and C_j to one excitation (equations 2 to 5).

    Args:
        recording: recording with a phase "excitation" in which the base oscillates steadily.
        com_at_stance: (3,) CoM in the base frame at the nominal stance [m]: x and y estimated, z from the model.
        stance: (nj,) joint positions of the nominal stance [rad].

    Raises:
        RecordingError: the recording has no joint torques, or no oscillation.
    """
    steady = recording.phase(Phase.EXCITATION)
    index = AXES.index(axis)
    rotation_imu_to_base = np.array(robot.imu_in_base.rotation)
    start = steady.imu.time[0]
    angular_velocity = (steady.imu.angular_velocity_in_imu @ rotation_imu_to_base.T)[:, index]
    sinusoid = dominant_sinusoid(steady.imu.time - start, angular_velocity)
    time, torque = torque_about_com(robot, steady, com_at_stance, stance)
    time, torque = _whole_periods(time - start, torque[:, index], sinusoid.frequency)
    torque = torque - torque.mean()
    # Torques are means over a sample interval d, which scales a sinusoid by sinc(F d).
    smoothing = np.sinc(sinusoid.frequency * float(np.mean(np.diff(time))))
    regressor = smoothing * np.column_stack([sinusoid.derivative(time), sinusoid.value(time)])  # equation 5
    solution = np.asarray(np.linalg.lstsq(regressor, torque, rcond=None)[0], dtype=float)
    inertia, damping = (float(value) for value in solution)
    measured = np.interp(time, steady.imu.time - start, angular_velocity)
    return AxisFit(axis, inertia, damping, sinusoid, time, measured, torque, regressor @ [inertia, damping])


def torque_about_com(
    robot: RobotModel, recording: Recording, com_at_stance: FloatArray, stance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Compute the torque of the ground forces about the CoM in base axes: the sum of (r_i - c) x f_i in equation 1.

    Foot Jacobians turn joint torques into forces, as for massless legs. The model determines how the CoM moves with the legs.

    Returns:
        (n,) times [s] and (n, 3) torques [Nm].
    """
    joints = recording.joints
    if joints.torque is None:
        raise RecordingError("the recording has no joint torques; moments of inertia need them")
    rate = 1 / float(np.mean(np.diff(joints.time)))
    block = max(1, round(rate / _TORQUE_RATE))
    kinematics = Kinematics(robot)
    offset = com_at_stance - kinematics.com(stance)
    # Means over a block of samples: less torque noise, and positions and torques of the same time.
    count = len(joints.time) // block * block
    time, positions, torques = (
        array[:count].reshape(-1, block, *array.shape[1:]).mean(axis=1)
        for array in (joints.time, joints.position, joints.torque)
    )
    feet, forces = feet_and_forces(robot, positions, torques)
    coms = np.array([kinematics.com(position) for position in positions])
    return time, np.cross(feet - (coms + offset)[:, None], forces).sum(axis=1)


def _whole_periods(time: FloatArray, signal: FloatArray, frequency: float) -> tuple[FloatArray, FloatArray]:
    """Return the longest part from the start with a whole number of periods: a sinusoid's mean over it is zero."""
    step = float(np.mean(np.diff(time)))
    periods = int((time[-1] - time[0] + step) * frequency + 0.1)  # the last period may lack a block of samples
    if periods < 1:
        raise RecordingError(f"the excitation lasts less than one period of {frequency:.2f} Hz")
    count = min(len(time), round(periods / frequency / step))
    return time[:count], signal[:count]
