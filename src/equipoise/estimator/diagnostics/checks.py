"""Checks of an estimate, and their messages."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from statistics import NormalDist

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.estimator.diagnostics.imu_position_check import imu_position_difference
from equipoise.estimator.diagnostics.score import ScoreTest, score_tests
from equipoise.estimator.equations.equation import MotionResidual, MotionSamples
from equipoise.estimator.equations.stance_motion import StanceMotions
from equipoise.estimator.equations.tilt import TiltEquation
from equipoise.estimator.equations.torque_balance import TorqueBalance
from equipoise.estimator.measurements.lift_samples import StepSamples
from equipoise.estimator.measurements.support_planes import com_by_planes
from equipoise.estimator.problem import Posterior, body_jacobian, prior_rows
from equipoise.recording.trials import DesignedLift, LiftTrial
from equipoise.result.findings import Check
from equipoise.result.held_out import FOUND, MODEL, HeldOut
from equipoise.result.mass_comparison import MassComparison
from equipoise.result.shown import called
from equipoise.result.statistics import NORMAL_95
from equipoise.robot.inertial import COMPONENTS, composite_parameters

# Normalized residuals: fault-free runs have medians of 0.4 to 1.4, and single motions up to 2.
_LARGE_RESIDUAL, _LARGE_MEDIAN = 3.0, 2.0
_OUTLIERS = 0.25  # of all lifts or moves: one of four is too many
_FEWEST_LIFTS = 4
# Standard deviations. The largest of ten parameters times some forty motions is 2 to 4 by chance.
_OUTLYING_SHIFT, _STEADY = 5.0, 5.0
# False-alarm probability over all fixed parameters: the limit is 2.9 normal deviates if three are tested, 3.6 if thirty are.
# Clean development runs came to 1.9 and to 2.5 (perfect sensors: compliant contacts).
_SCORE_FALSE_ALARM = 5e-3
_HELD_OUT_FALSE_ALARM = 1e-2  # lifts in one posture count as one
_CAUSES = 3  # one wrong fixed parameter raises the scores of similar ones
_FEWEST_SIDE = 3  # motions before and after a change: one or two that differ are outliers
_CHANGE = 0.1  # prior of a change, over that of the base: a payload that moves does not replace the robot
_SMALL_SHIFT = 0.1  # of a posterior standard deviation: smaller shifts are below the accuracy of first order
_IMPLAUSIBLE = 4.0  # prior standard deviations: some sixty sensor errors are tested
_INFORMATIVE = 0.05  # least variance that a run removes, in units of the prior
_TORQUE_RESIDUAL = 1.4  # of the torque balance: 1.0 to 1.1 in fault-free runs
_LEGS_DIFFER = 4.0
# [m] on an A1, planar and height: the geometric CoM is not corrected for sensor biases; 1.4 and 4 mm rms in fault-free runs.
_PLANES_AGREE = (7e-3, 25e-3)
_IMU_DIFFERS = 2.5  # standard deviations
_TETHER_LIMIT = 3.0  # standard deviations: a false alarm in one clean run of 700
_IMPOSSIBLE = 3.0  # standard deviations below zero: clean runs come to 1.1, feet with edges and liquids to 3.7
# Causes that no equation models.
_OUTSIDE = "a safety sling, hose or cable carries load"
_SHAPES = f"feet are wide or worn flat, a load swings or flows, or {_OUTSIDE}"
_REPEAT = "Remove the cause and calibrate again"
HELD_OUT_CHECK = "held-out prediction"
_UNDETERMINED = 0.02  # [m] on an A1: an excitation about one axis does not determine the position along it


def run_checks(
    posterior: Posterior,
    predicted: HeldOut | None = None,
    masses: MassComparison | None = None,
) -> list[Check]:
    """Return all checks, causes before their effects.

    Args:
        predicted: held-out predictions of the lifts; None: there are none.
        masses: given mass and mass that the joint torques carry; None: there is nothing to compare.
    """
    return [
        _sufficient_data(posterior),
        _stance_motion_residuals(posterior),
        _lift_residuals(posterior),
        _torque_mass(posterior, masses),
        _convergence(posterior),
        _fixed_parameters(posterior),
        _model_file(posterior),
        _imu_position(posterior),
        _change_during_run(posterior),
        _leave_one_out(posterior),
        *([] if predicted is None else [_held_out_prediction(predicted)]),
        _sensor_errors(posterior),
        _physical_parameters(posterior),
        _tether(posterior),
        _left_and_right(posterior),
        _support_planes(posterior),
    ]


def shifts_without(posterior: Posterior, groups: Sequence[Collection[int]]) -> tuple[FloatArray, FloatArray]:
    """Return the changes of the whole robot's parameters without each of n groups of motions, to first order.

    Returns:
        (n, 10) shifts in the order of COMPONENTS, and (n, 10) the same over their standard deviations.
    """
    to_body = body_jacobian(posterior.unknowns, posterior.x, posterior.unknowns.robot_body)
    floor = _SMALL_SHIFT**2 * np.diag(posterior.robot_covariance)
    shifts: list[FloatArray] = []
    stds: list[FloatArray] = []
    for group in groups:
        step, covariance = posterior.without(group)
        shift = to_body @ step
        variance = np.diag(to_body @ (covariance - posterior.covariance) @ to_body.T)
        shifts.append(shift)
        stds.append(shift / np.sqrt(np.maximum(variance, floor)))
    return np.array(shifts), np.array(stds)


def half_difference(posterior: Posterior) -> FloatArray:
    """Return the (size,) estimate from the first half of the motions less that from the second half, to first order."""
    motions = sorted(posterior.information)
    middle = len(motions) // 2
    first, second = (posterior.without(half)[0] for half in (motions[middle:], motions[:middle]))
    return first - second


def _judged(name: str, passed: bool, message: str, remedy: str) -> Check:
    """Return a check whose message ends with cause and remedy if it failed."""
    return Check(name, passed, message if passed else f"{message}. {remedy}")


def _sufficient_data(posterior: Posterior) -> Check:
    motions, on_two_feet = posterior.motions, posterior.residuals_of(TiltEquation)
    steps = sum(one.used for one in on_two_feet if motions[one.motion].lift is None)
    used = sum(one.used for one in on_two_feet)
    moves = sum(one.used for one in posterior.residuals_of(StanceMotions))
    left_out = [motion for motion in motions if motion.left_out]
    reasons = sorted({str(motion.left_out) for motion in left_out})
    counts = [f"{used - steps} lifts", *([f"{steps} steps of a walk"] if steps else [])]
    message = f"{', '.join(counts)} and {moves} stance motions are used"
    if left_out:
        message += f"; {len(left_out)} motions could not be read: {'; '.join(reasons)}"
    lifts = used - steps
    tried = lifts + sum(isinstance(motion.trial, LiftTrial) for motion in left_out)
    passed = used >= _FEWEST_LIFTS and lifts >= 0.7 * tried
    remedy = f"At least {_FEWEST_LIFTS} lifts or steps, and 70 % of all lifts, must be usable: repeat the run"
    return _judged("sufficient data", passed, message, remedy)


def _lift_residuals(posterior: Posterior) -> Check:
    lifts, motions = posterior.residuals_of(TiltEquation), posterior.motions
    if not lifts:
        return Check("lift residuals", False, "no lifts: the estimate uses joint torques alone. Record lift trials")
    walked = all(motions[one.motion].lift is None for one in lifts)
    message = _residual_summary(motions, lifts, "steps" if walked else "lifts")
    remedy = f"Feet slip, {_OUTSIDE}, a load shifts, samples are missing, or the model or a sensor is wrong. {_REPEAT}"
    return _judged("lift residuals", _residuals_pass(lifts), message, remedy)


def _stance_motion_residuals(posterior: Posterior) -> Check:
    name, moves, motions = "stance motion residuals", posterior.residuals_of(StanceMotions), posterior.motions
    if not moves:
        if any(motion.of(StepSamples) for motion in motions) and not any(motion.lift for motion in motions):
            return Check(name, True, "not tested: a walk has no stance motions; joint offsets keep their priors")
        return Check(name, False, "no stance motions to separate joint offsets from the CoM. Record stance motions")
    message = _residual_summary(motions, moves, "stance motions")
    remedy = (
        "The feet do not stay in place: they slip, the legs differ from the model (lengths, foot frames), an encoder is "
        f"wrong, or {_OUTSIDE}. {_REPEAT}"
    )
    return _judged(name, _residuals_pass(moves), message, remedy)


def _residuals_pass(residuals: tuple[MotionResidual, ...]) -> bool:
    sizes = np.array([one.normalized_residual for one in residuals])
    return bool(np.mean(sizes > _LARGE_RESIDUAL) < _OUTLIERS and np.median(sizes) < _LARGE_MEDIAN)


def _convergence(posterior: Posterior) -> Check:
    message = "the estimate converged"
    if not posterior.converged:
        message = (
            f"the estimate did not converge: do not use its values or intervals. Feet slip, {_OUTSIDE}, or the model file is "
            f"of another robot. {_REPEAT}"
        )
    return Check("convergence", posterior.converged, message)


def _residual_summary(motions: Sequence[MotionSamples], residuals: tuple[MotionResidual, ...], kind: str) -> str:
    sizes = np.array([one.normalized_residual for one in residuals])
    worst = residuals[int(np.argmax(sizes))]
    trial = motions[worst.motion].trial
    words = trial.diagonal if isinstance(trial, LiftTrial) else ""
    if isinstance(trial, DesignedLift) and trial.meanwhile != "passive":
        words += f", {trial.meanwhile}"
    message = (
        f"median normalized residual of {kind}: {np.median(sizes):.1f} (limit {_LARGE_MEDIAN:g}); worst: "
        f"motion {worst.motion}{f' ({words})' if words else ''} with {worst.normalized_residual:.1f}"
    )
    out = [str(one.motion) for one in residuals if not one.used]
    return message + (f"; left out: {', '.join(out)}" if out else "")


def _leave_one_out(posterior: Posterior) -> Check:
    motions = sorted(posterior.information)
    _, stds = shifts_without(posterior, [[motion] for motion in motions])
    row, component = np.unravel_index(int(np.argmax(np.abs(stds))), stds.shape)
    largest, motion = float(abs(stds[row, component])), motions[int(row)]
    trial = posterior.motions[motion].trial
    kind = "motion" if trial is None else trial.kind
    passed = largest < _OUTLYING_SHIFT
    message = (
        f"{'largest effect of one motion: ' if passed else ''}without {kind} {motion}, {called(COMPONENTS[component])} "
        f"changes by {largest:.1f} standard deviations (limit {_OUTLYING_SHIFT:g})"
    )
    return _judged("leave-one-out", passed, message, "A disturbance of this motion is likely: repeat the run")


def _held_out_prediction(predicted: HeldOut) -> Check:
    sizes = NORMAL_95 * np.array([lift.intervals[FOUND] for lift in predicted.lifts])
    size = float(np.sqrt(np.mean(sizes**2)))
    limit = _rms_by_chance(predicted.folds)
    passed = size < limit
    message = f"{predicted.message()}; rms error {size:.1f} standard deviations (limit {limit:.1f})"
    if passed and predicted.error(FOUND) > predicted.error(MODEL):
        message += ". The model file predicts at least as well: increase --duration to distinguish the two"
    remedy = (
        "One posture contradicts the others: the legs differ from the model (lengths, hips), a part bends or swings, a "
        f"foot slips, {_OUTSIDE}, or the floor is uneven. {_REPEAT}"
    )
    return _judged(HELD_OUT_CHECK, passed, message, remedy)


def _rms_by_chance(count: int) -> float:
    """Return the rms that so many normal deviates exceed at the false-alarm probability (Wilson and Hilferty 1931)."""
    spread = 2 / (9 * count)
    return (1 - spread + NormalDist().inv_cdf(1 - _HELD_OUT_FALSE_ALARM) * spread**0.5) ** 1.5


def _fixed_parameters(posterior: Posterior) -> Check:
    name, tests = "fixed-parameter score test", [test for test in score_tests(posterior) if test.deviate > -np.inf]
    if not tests:
        return Check(name, True, "the run is not sensitive to any fixed parameter")
    limit = NormalDist().inv_cdf(1 - _SCORE_FALSE_ALARM / len(tests))
    far = [test for test in tests if test.deviate > limit]
    if not far:
        return Check(name, True, f"largest score: {tests[0].row.name}, {tests[0].deviate:.1f} (limit {limit:.1f})")
    return Check(name, False, "; or ".join(_cause(posterior, test, limit) for test in far[:_CAUSES]))


def _cause(posterior: Posterior, test: ScoreTest, limit: float) -> str:
    row, unknowns = test.row, posterior.unknowns
    index = int(np.argmax(np.abs(test.values)))
    most = f"{row.label.format(each=unknowns.labels(row)[index])} {test.values[index]:+.2g} {row.unit}".strip()
    opened = f"{row.opened_by} or " if row.opened_by else ""
    return (
        f"{row.cause} (score {test.deviate:.1f}, limit {limit:.1f}; {most}). {row.name} is fixed at the model's value: "
        f"estimate it with {opened}{row.name} = {row.usual:g} in --priors"
    )


def _model_file(posterior: Posterior) -> Check:
    """Test for conflicts with the file. A single one is estimated; several may come from effects that are not modelled."""
    rows = posterior.unknowns.priors.widened
    if not rows:
        return Check("model file", True, "no conflict with the leg geometry and IMU position of the file")
    message = "; ".join(row.cause for row in rows)
    if len(rows) > 1:
        return Check("model file", False, f"{message}: the file may be of another robot, or feet slip. Check both")
    return Check("model file", True, f"{message}; the estimate does not depend on this value of the file")


def _imu_position(posterior: Posterior) -> Check:
    """Test the estimated position of the IMU against an excitation, which does not depend on inertia."""
    name, compared = "IMU position", imu_position_difference(posterior)
    if compared is None or posterior.imu_by_excitation is None:
        return Check(name, True, "not tested: the run has no excitation about all axes")
    apart, std, largest = compared
    passed, determined = largest < _IMU_DIFFERS, std < _UNDETERMINED * posterior.unknowns.stance.scale.length

    def shown(vector: FloatArray) -> str:
        sizes = zip("xyz", 1000 * vector, determined, strict=True)
        axes = [f"{axis} {size:+.1f}" for axis, size, valid in sizes if valid]
        return f"{', '.join(axes)} mm" if axes else "undetermined"

    difference = f"{shown(apart)} (base axes), at most {largest:.1f} standard deviations (limit {_IMU_DIFFERS:g})"
    if passed:
        return Check(name, True, f"the excitation confirms the estimated position of the IMU; difference: {difference}")
    message = (
        f"the excitation contradicts the estimated position of the IMU; difference: {difference}. The excitation places it "
        f"{shown(posterior.imu_by_excitation[0])} from the model's position; wrong leg lengths look the same. Inertia depends "
        "on it: measure the position, and correct it in the model file or as imu_position in a robot configuration"
    )
    return Check(name, False, message)


def _change_during_run(posterior: Posterior) -> Check:
    """Score test at every motion for a change of the base, with the same sensors, legs and joints."""
    unknowns, covariance = posterior.unknowns, posterior.covariance
    base, motions = unknowns["base"], sorted(posterior.information)
    to_body = body_jacobian(unknowns, posterior.x, unknowns.robot_body)[:, base]
    prior = prior_rows(unknowns, posterior.x, None)[1][:, base] / _CHANGE
    floor = _SMALL_SHIFT**2 * np.diag(posterior.robot_covariance)
    later, score = np.zeros((10, unknowns.size)), np.zeros(10)
    largest, component, change, start = 0.0, 0, 0.0, 0
    for motion in reversed(motions[_FEWEST_SIDE:]):
        later += posterior.information[motion][base]
        score += posterior.gradient[motion][base]
        if motion > motions[-_FEWEST_SIDE]:
            continue
        information = later[:, base] - later @ covariance @ later.T
        gain = to_body @ np.linalg.inv(information + prior.T @ prior)
        changes = -gain @ score
        stds = np.abs(changes) / np.sqrt(np.maximum(np.diag(gain @ information @ gain.T), floor))
        index = int(np.argmax(stds))
        if stds[index] > largest:
            largest, component, change, start = float(stds[index]), index, float(changes[index]), motion
    unit = "kg" if component == 0 else "m" if component < 4 else "kg m2"
    passed = largest < _STEADY
    message = (
        f"{'largest change during the run: ' if passed else ''}from motion {start} on, {called(COMPONENTS[component])} "
        f"differs by {change:+.4f} {unit}, {largest:.1f} standard deviations (limit {_STEADY:g})"
    )
    remedy = f"A payload or part moved, sensors drift, or {_OUTSIDE}. Fasten parts, warm up the IMU, repeat the run"
    return _judged("change during the run", passed, message, remedy)


def _sensor_errors(posterior: Posterior) -> Check:
    unknowns = posterior.unknowns
    far = [
        (abs(float(value)), row.label.format(each=label))
        for row in unknowns.rows
        if row.checked
        for value, label in zip(posterior.x[unknowns[row.name]], unknowns.labels(row), strict=True)
    ]
    worst = sorted(far, reverse=True)
    named = ", ".join(f"{name} ({size:.1f})" for size, name in worst[:3])
    passed = worst[0][0] < _IMPLAUSIBLE
    message = f"largest errors, in prior standard deviations (limit {_IMPLAUSIBLE:g}): {named}"
    remedy = f"A sensor is faulty, the model file is of another robot, or {_OUTSIDE}. {_REPEAT}"
    return _judged("sensor errors", passed, message, remedy)


def _physical_parameters(posterior: Posterior) -> Check:
    """Test that compliance, backlash, rolling resistance and friction are not negative beyond their uncertainty."""
    lowest = sorted(
        (value / std, row.label.format(each=label))
        for row in posterior.unknowns.rows
        if row.nonnegative and row.name in posterior.informed
        for label, value, std in posterior.of_row(row)
    )
    if not lowest:
        return Check("physical parameters", True, "no compliance, backlash or friction is estimated")
    shown = [f"{name} ({size:+.1f} standard deviations)" for size, name in lowest]
    negative = [words for words, (size, _) in zip(shown, lowest, strict=True) if size < -_IMPOSSIBLE]
    if not negative:
        return Check(
            "physical parameters",
            True,
            f"no value is more than {_IMPOSSIBLE:g} standard deviations below zero; lowest: {shown[0]}",
        )
    message = f"negative, which is impossible: {', '.join(negative)}. Possible causes: {_SHAPES}. {_REPEAT}"
    return Check("physical parameters", False, message)


def _tether(posterior: Posterior) -> Check:
    """Test that nothing holds the trunk back: the other effects of a tether are not modelled."""
    if not posterior.unknowns.estimates("tether_stiffness"):
        return Check("tether", True, "no tether stiffness is estimated")
    ((_, stiffness, std),) = posterior.of_row(posterior.unknowns.priors.row("tether_stiffness"))
    if stiffness < _TETHER_LIMIT * std:
        limit = f"within {_TETHER_LIMIT:g} standard deviations of zero"
        return Check("tether", True, f"no tether is detected: stiffness {stiffness:+.1f} N/m, {limit}")
    message = (
        f"a hose or a tether holds the trunk back with {stiffness:.1f} N/m (standard deviation {std:.1f}): remove it, "
        "or let it hang slack"
    )
    return Check("tether", False, message)


def _torque_mass(posterior: Posterior, masses: MassComparison | None) -> Check:
    """Test that the torque gains have no common error, which a wrong mass would cause, and that the torques balance."""
    name, balance = "torque-mass consistency", posterior.problem.equation(TorqueBalance)
    if balance is None:
        return Check(name, True, "not tested: the recordings contain no joint torques")
    unknowns, residual = posterior.unknowns, balance.normalized_residual
    balanced = f"normalized residual of the torque balance {residual:.1f} (limit {_TORQUE_RESIDUAL:g})"
    gains = unknowns["torque_gain"]
    if not unknowns.estimates("torque_gain"):
        return Check(name, residual < _TORQUE_RESIDUAL, f"{balanced}; torque gains are fixed")
    # The best estimate of a common error of all gains. An estimated gain shrinks to zero as far as the run does not determine
    # it (most joints of a standing robot carry little), and its chance variance is what the run removed from the prior's.
    mean, before = unknowns.prior("torque_gain")
    removed = float((before - posterior.covariance[gains, gains]).sum())
    if unknowns.run_prior is not None:  # half a minute may add less than rounding
        removed = max(removed, _INFORMATIVE)
    common = float((posterior.x[gains] - mean).sum())
    size = abs(common) / float(np.sqrt(removed))
    off = common / removed * unknowns.priors.torque_gain
    message = (
        f"{'' if masses is None else f'{masses.message}; '}common torque gain error at the estimated mass of "
        f"{posterior.robot_body.mass:.2f} kg: {off:+.1%}, {size:.1f} standard deviations (limit {_IMPLAUSIBLE:g}); {balanced}"
    )
    agree = masses is None or not masses.disagrees
    passed = agree and size < _IMPLAUSIBLE and residual < _TORQUE_RESIDUAL
    remedy = (
        f"The given mass is wrong, torques are not joint torques in Nm, or {_OUTSIDE}. Weigh the robot again, and check "
        "the units of torques"
    )
    return _judged(name, passed, message, remedy)


def _left_and_right(posterior: Posterior) -> Check:
    """Test that the link masses of mirrored legs agree."""
    unknowns = posterior.unknowns
    if not unknowns.estimates("leg_mass"):
        return Check("left and right", True, "not tested: leg masses are fixed at the model's values")
    links = len(unknowns.robot.legs["FL"].joint_ids)
    block = posterior.covariance[unknowns["leg_mass"], unknowns["leg_mass"]]
    worst, name = 0.0, ""
    for left, right in ((0, 1), (2, 3)):
        for link in range(links):
            a, b = left * links + link, right * links + link
            difference = float(posterior.x[unknowns["leg_mass"]][a] - posterior.x[unknowns["leg_mass"]][b])
            # Variance of the estimated difference: that of the prior less that of the posterior.
            allowed = float(np.sqrt(max(2.0 - (block[a, a] + block[b, b] - 2 * block[a, b]), 0.05)))
            if abs(difference) / allowed > worst:
                worst, name = abs(difference) / allowed, ("front" if left == 0 else "rear") + f" link {link + 1}"
    passed = worst < _LEGS_DIFFER
    message = f"largest left-right mass difference: {name or 'none'}, {worst:.1f} standard deviations (limit {_LEGS_DIFFER:g})"
    return _judged("left and right", passed, message, "Look for a part or damage on one of these legs")


def _support_planes(posterior: Posterior) -> Check:
    """Compare the CoM with the intersection of the lifts' support planes."""
    robot, stance = posterior.unknowns.robot, posterior.unknowns.stance
    lifts = [motion.lift for motion in posterior.motions if motion.lift is not None]
    com = com_by_planes(robot, composite_parameters(robot, stance.joint_position).com, lifts)
    if com is None:
        return Check("support planes", True, "not tested: the run has too few lifts to intersect their support planes")
    off = com - posterior.robot_body.com
    x, y, z = 1000 * off
    planar, height = (stance.scale.length * limit for limit in _PLANES_AGREE)
    passed = np.hypot(*off[:2]) < planar and abs(off[2]) < height
    message = (
        f"the support planes of {len(lifts)} lifts meet {x:+.1f} {y:+.1f} {z:+.1f} mm from the estimated CoM (base axes); "
        f"limits: {1000 * planar:.0f} mm horizontally, {1000 * height:.0f} mm in height (sensor biases not corrected)"
    )
    return _judged("support planes", bool(passed), message, "Check the IMU's mounting and the model file")
