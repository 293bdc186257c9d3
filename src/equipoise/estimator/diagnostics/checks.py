"""What a result says about itself: questions whose answer can be no."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from statistics import NormalDist

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.estimator.diagnostics.imu_position_check import ImuPositionCheck
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

# Residual over what the sensors' noise explains: fault-free runs have medians of 0.4 to 1.4, and single motions up to 2.
_LARGE_MISFIT, _LARGE_MEDIAN = 3.0, 2.0
_OUTLIERS = 0.25  # of all lifts or moves: one of four is too many
_FEWEST_LIFTS = 4
# Standard deviations. The largest of ten parameters times some forty motions is 2 to 4 by chance.
_OUTLYING_SHIFT, _STEADY = 5.0, 5.0
# Chance that any row that is held is called wrong in a run where none is: 2.9 normal deviates if three are tested, 3.6 if
# thirty are. Clean development runs came to 1.9 and to 2.5 (perfect sensors: contacts that give).
_UNLIKELY = 5e-3
# Chance that predictions as good as their intervals say are called worse: lifts in one posture count as one.
_UNPREDICTED = 1e-2
_CAUSES = 3  # what is wrong of one thing pulls at what is alike
_FEWEST_SIDE = 3  # motions before and after a change: one or two that differ are outliers
_CHANGE = 0.1  # of what is not known of the base beforehand: what moves on a robot is no new robot
_SMALL_SHIFT = 0.1  # of a posterior standard deviation: first order is not surer than that, and nobody minds less
_IMPLAUSIBLE = 4.0  # prior standard deviations: some sixty sensor errors are looked at
_TOLD = 0.05  # variance that a run took away at least; in units of the prior
_TORQUE_MISFIT = 1.4  # of the torque balance: 1.0 to 1.1 in fault-free runs
_LEGS_DIFFER = 4.0
# [m] on an A1, planar and height: the geometric reading knows no sensor biases; 1.4 and 4 mm rms in fault-free runs.
_PLANES_AGREE = (7e-3, 25e-3)
_NOT_THERE = 2.5  # standard deviations that an excitation has the IMU elsewhere by
_HELD_BACK = 3.0  # standard deviations: one clean run in 700 is called held
_IMPOSSIBLE = 3.0  # standard deviations below zero: clean runs come to 1.1, feet with edges and liquids to 3.7
# What an estimate without a word for it takes for something else.
_OUTSIDE = "a safety sling, hose or cable carries load"
_SHAPES = f"feet are wide or worn flat, a load swings or flows, or {_OUTSIDE}"
HELD_OUT_CHECK = "held-out prediction"
_SAYS_NOTHING = 0.02  # [m] on an A1: an excitation about one axis does not tell the place along it


def judge(
    posterior: Posterior,
    predicted: HeldOut | None = None,
    masses: MassComparison | None = None,
) -> list[Check]:
    """All checks, in the order in which a user should read them: causes before what they cause.

    Args:
        predicted: the lifts, each predicted by an estimate without it; None: they were not predicted.
        masses: given mass and mass that the joint torques carry; None: there is nothing to compare.
    """
    return [
        _enough(posterior),
        _feet_stay(posterior),
        _lifts_fit(posterior),
        _torques_carry_the_mass(posterior, masses),
        _converged(posterior),
        _held_fits(posterior),
        _file_is_of_this_robot(posterior),
        _imu_is_there(posterior),
        _halves_agree(posterior),
        _no_motion_outweighs(posterior),
        *([] if predicted is None else [_predicts(predicted)]),
        _sensors_plausible(posterior),
        _physically_possible(posterior),
        _nothing_holds_it(posterior),
        _left_and_right_agree(posterior),
        _planes_agree(posterior),
    ]


def shift_without(posterior: Posterior, motions: Collection[int]) -> tuple[FloatArray, FloatArray]:
    """How the whole robot's parameters move if motions are left out, to first order.

    Returns:
        (10,) shifts in the order of COMPONENTS, and (10,) in standard deviations that such a shift has by chance.
    """
    shifts, stds = _shifts_without(posterior, [motions])
    return shifts[0], stds[0]


def _shifts_without(posterior: Posterior, groups: Sequence[Collection[int]]) -> tuple[FloatArray, FloatArray]:
    """(n, 10) `shift_without` each of n groups of motions."""
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
    """Return the (size,) unknowns by the first half of the motions less those by the second half, to first order."""
    motions = sorted(posterior.information)
    middle = len(motions) // 2
    first, second = (posterior.without(half)[0] for half in (motions[middle:], motions[:middle]))
    return first - second


def _enough(posterior: Posterior) -> Check:
    motions, on_two_feet = posterior.motions, posterior.residuals_of(TiltEquation)
    steps = sum(
        normalized_residual.used
        for normalized_residual in on_two_feet
        if motions[normalized_residual.motion].lift is None
    )
    used = sum(normalized_residual.used for normalized_residual in on_two_feet)
    moves = sum(normalized_residual.used for normalized_residual in posterior.residuals_of(StanceMotions))
    left_out = [motion for motion in motions if motion.left_out]
    reasons = sorted({str(motion.left_out) for motion in left_out})
    told = [f"{used - steps} lifts", *([f"{steps} steps of a walk"] if steps else [])]
    message = f"{', '.join(told)} and {moves} stance motions are used"
    if left_out:
        message += f"; {len(left_out)} motions could not be read: {'; '.join(reasons)}"
    lifts = used - steps
    tried = lifts + sum(isinstance(motion.trial, LiftTrial) for motion in left_out)
    return Check("sufficient data", used >= _FEWEST_LIFTS and lifts >= 0.7 * tried, message)


def _lifts_fit(posterior: Posterior) -> Check:
    lifts, motions = posterior.residuals_of(TiltEquation), posterior.motions
    if not lifts:
        return Check("lift residuals", False, "there is no lift of two feet: what is found is what joint torques say")
    walked = all(motions[one.motion].lift is None for one in lifts)
    message = _residual_summary(motions, lifts, "step" if walked else "lift")
    passed = _fit(lifts)
    if not passed:
        message += f". Feet slip, {_OUTSIDE}, a load shifts, samples are missing, or the model or a sensor is wrong"
    return Check("lift residuals", passed, message)


def _feet_stay(posterior: Posterior) -> Check:
    moves, motions = posterior.residuals_of(StanceMotions), posterior.motions
    if not moves:
        if any(motion.of(StepSamples) for motion in motions) and not any(motion.lift for motion in motions):
            return Check(
                "stance motion residuals", True, "it walks: intervals are as wide as joint offsets are unknown"
            )
        return Check(
            "stance motion residuals",
            False,
            "there is no move over planted feet: joint offsets cannot be told from the CoM",
        )
    message = _residual_summary(motions, moves, "move")
    passed = _fit(moves)
    if not passed:
        message += (
            ". The feet do not keep their places: they slip, the legs are not the model's (lengths, foot frames), a joint's "
            f"encoder is wrong, or {_OUTSIDE}"
        )
    return Check("stance motion residuals", passed, message)


def _fit(normalized_residuals: tuple[MotionResidual, ...]) -> bool:
    residuals = np.array([normalized_residual.normalized_residual for normalized_residual in normalized_residuals])
    return bool(np.mean(residuals > _LARGE_MISFIT) < _OUTLIERS and np.median(residuals) < _LARGE_MEDIAN)


def _converged(posterior: Posterior) -> Check:
    message = "the estimate settled"
    if not posterior.converged:
        message = (
            "the estimate did not converge: something does not fit at all, and intervals and shifts mean nothing. Feet slip, "
            f"{_OUTSIDE}, or the model file is another robot's"
        )
    return Check("convergence", posterior.converged, message)


def _residual_summary(
    motions: Sequence[MotionSamples], normalized_residuals: tuple[MotionResidual, ...], kind: str
) -> str:
    residuals = np.array([normalized_residual.normalized_residual for normalized_residual in normalized_residuals])
    worst = normalized_residuals[int(np.argmax(residuals))]
    trial = motions[worst.motion].trial
    words = trial.diagonal if isinstance(trial, LiftTrial) else ""
    if isinstance(trial, DesignedLift) and trial.meanwhile != "passive":
        words += f", {trial.meanwhile}"
    message = (
        f"{kind}s fit with {np.median(residuals):.1f} times their noise (median); worst: motion {worst.motion}"
        f"{f' ({words})' if words else ''} with {worst.normalized_residual:.1f}"
    )
    out = [
        str(normalized_residual.motion) for normalized_residual in normalized_residuals if not normalized_residual.used
    ]
    return message + (f"; left out: {', '.join(out)}" if out else "")


def _no_motion_outweighs(posterior: Posterior) -> Check:
    motions = sorted(posterior.information)
    _, sds = _shifts_without(posterior, [[motion] for motion in motions])
    row, component = np.unravel_index(int(np.argmax(np.abs(sds))), sds.shape)
    largest, culprit = float(abs(sds[row, component])), motions[int(row)]
    trial = posterior.motions[culprit].trial
    kind = "motion" if trial is None else trial.kind
    passed, name = largest < _OUTLYING_SHIFT, called(COMPONENTS[component])
    if passed:
        message = (
            f"no motion outweighs the others: without {kind} {culprit}, which counts most, {name} moves by {largest:.1f} of "
            f"up to {_OUTLYING_SHIFT:g} standard deviations"
        )
    else:
        message = f"without {kind} {culprit} {name} would move by {largest:.1f} times what chance explains"
    return Check("leave-one-out", passed, message)


def _predicts(predicted: HeldOut) -> Check:
    """Whether what was found predicts lifts that it has not seen as well as its intervals say."""
    sizes = NORMAL_95 * np.array([lift.intervals[FOUND] for lift in predicted.lifts])
    size = float(np.sqrt(np.mean(sizes**2)))
    limit = _rms_by_chance(predicted.folds)
    passed = size < limit
    message = (
        f"{predicted.message()}; errors are {size:.1f} times their standard deviation, {limit:.1f} by chance at most"
    )
    if passed and predicted.error(FOUND) > predicted.error(MODEL):
        message += ". The model file predicts them as well: the run is too short to distinguish the robot from its file"
    if not passed:
        message += (
            ". One posture contradicts the others: the legs are not the model's (lengths, hips), something bends or swings, a "
            f"foot slips, {_OUTSIDE}, or the floor is uneven"
        )
    return Check(HELD_OUT_CHECK, passed, message)


def _rms_by_chance(count: int) -> float:
    """Root mean square that so many normal deviates exceed with that chance (Wilson and Hilferty 1931)."""
    spread = 2 / (9 * count)
    return (1 - spread + NormalDist().inv_cdf(1 - _UNPREDICTED) * spread**0.5) ** 1.5


def _held_fits(posterior: Posterior) -> Check:
    """Whether something that the estimate takes for the model's is not so."""
    tests = [test for test in score_tests(posterior) if test.deviate > -np.inf]
    if not tests:
        return Check("fixed-parameter score test", True, "nothing that the run could see is held at the model's value")
    limit = NormalDist().inv_cdf(1 - _UNLIKELY / len(tests))
    far = [test for test in tests if test.deviate > limit]
    if not far:
        message = (
            f"what is held fits; {tests[0].row.name} least, to {tests[0].deviate:.1f} of {limit:.1f} normal deviates"
        )
        return Check("fixed-parameter score test", True, message)
    return Check("fixed-parameter score test", False, "; or ".join(_cause(posterior, test) for test in far[:_CAUSES]))


def _cause(posterior: Posterior, test: ScoreTest) -> str:
    row, unknowns = test.row, posterior.unknowns
    index = int(np.argmax(np.abs(test.values)))
    most = f"{row.label.format(each=unknowns.labels(row)[index])} {test.values[index]:+.2g} {row.unit}".strip()
    opened = f"{row.opened_by} or " if row.opened_by else ""
    return (
        f"{row.cause} ({test.deviate:.1f} normal deviates; {most}). It is held at the model's: make it unknown with "
        f"{opened}{row.name} = {row.usual:g} in --priors"
    )


def _file_is_of_this_robot(posterior: Posterior) -> Check:
    """What is wrong of one kind is found. What pulls at several may be something that nobody looks for, as feet that slip."""
    rows = posterior.unknowns.priors.not_of_this_robot
    if not rows:
        return Check("model file", True, "nothing speaks against legs and IMU being where the file has them")
    message = "; ".join(row.cause for row in rows)
    if len(rows) > 1:
        return Check("model file", False, f"{message}: it may be the file of another robot, or feet slip. Look at both")
    return Check("model file", True, f"the estimate does not depend on the file where it is wrong: {message}")


def _imu_is_there(posterior: Posterior) -> Check:
    """Whether the IMU, by an excitation over planted feet, sits where the estimate has it: no inertia goes into that."""
    name, by_excitation = "IMU position", ImuPositionCheck.of(posterior)
    if by_excitation is None:
        return Check(name, True, "there is no excitation about all axes, to see where the IMU sits by")
    passed = by_excitation.largest < _NOT_THERE
    told = by_excitation.std < _SAYS_NOTHING * posterior.unknowns.stance.scale.length

    def shown(vector: FloatArray) -> str:
        sizes = zip("xyz", 1000 * vector, told, strict=True)
        return ", ".join(f"{axis} {size:+.1f}" for axis, size, tells in sizes if tells) or "nothing is told"

    difference = (
        f"{shown(by_excitation.difference)} mm (base axes), at most {by_excitation.largest:.1f} standard deviations"
    )
    if passed:
        return Check(name, True, f"the excitation confirms the estimated position of the IMU; difference: {difference}")
    message = (
        f"by the excitation the IMU is not at its estimated position; difference: {difference}. It is not where the "
        f"model file has "
        f"it, but {shown(by_excitation.position)} mm from there, or legs are as much longer or shorter. Moments of "
        f"inertia depend "
        "on it: measure it, and correct the file, or imu_position in the robot's description"
    )
    return Check(name, False, message)


def _halves_agree(posterior: Posterior) -> Check:
    """Whether the base is another body after some motion than before it, with the same sensors, legs and joints.

    A score test at every motion: what the later motions pull at the base with, over what they would let it move by.
    """
    unknowns, covariance = posterior.unknowns, posterior.covariance
    base, motions = unknowns["base"], sorted(posterior.information)
    to_body = body_jacobian(unknowns, posterior.x, unknowns.robot_body)[:, base]
    prior = prior_rows(unknowns, posterior.x, None)[1][:, base] / _CHANGE
    floor = _SMALL_SHIFT**2 * np.diag(posterior.robot_covariance)
    later, pull = np.zeros((10, unknowns.size)), np.zeros(10)
    largest, component, change, start = 0.0, 0, 0.0, 0
    for motion in reversed(motions[_FEWEST_SIDE:]):
        later += posterior.information[motion][base]
        pull += posterior.gradient[motion][base]
        if motion > motions[-_FEWEST_SIDE]:
            continue
        told = later[:, base] - later @ covariance @ later.T
        gain = to_body @ np.linalg.inv(told + prior.T @ prior)
        changes = -gain @ pull
        sds = np.abs(changes) / np.sqrt(np.maximum(np.diag(gain @ told @ gain.T), floor))
        index = int(np.argmax(sds))
        if sds[index] > largest:
            largest, component, change, start = float(sds[index]), index, float(changes[index]), motion
    unit = "kg" if component == 0 else "m" if component < 4 else "kg m2"
    name = called(COMPONENTS[component])
    if largest < _STEADY:
        message = (
            f"the robot is the same throughout: its largest change, {name} by {change:+.4f} {unit} from motion {start} on, is "
            f"{largest:.1f} of up to {_STEADY:g} standard deviations"
        )
        return Check("split-half consistency", True, message)
    message = (
        f"from motion {start} on {name} seems to be {change:+.4f} {unit} other than before, {largest:.1f} times what chance "
        f"explains: a payload or something else on the robot moved, its sensors drift, or {_OUTSIDE}"
    )
    return Check("split-half consistency", False, message)


def _sensors_plausible(posterior: Posterior) -> Check:
    unknowns = posterior.unknowns
    far = [
        (abs(float(value)), row.label.format(each=label))
        for row in unknowns.rows
        if row.judged
        for value, label in zip(posterior.x[unknowns[row.name]], unknowns.labels(row), strict=True)
    ]
    worst = sorted(far, reverse=True)
    named = ", ".join(f"{name} ({size:.1f} sd)" for size, name in worst[:3])
    passed = worst[0][0] < _IMPLAUSIBLE
    message = f"farthest from what was expected beforehand: {named}"
    if passed:
        return Check("sensor errors", True, f"all are below {_IMPLAUSIBLE:g} prior standard deviations; {message}")
    message += f". So large an error is unlikely: that sensor is at fault, the model is not this robot's, or {_OUTSIDE}"
    return Check("sensor errors", False, message)


def _physically_possible(posterior: Posterior) -> Check:
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
            "physical parameters", True, f"none is negative by {_IMPOSSIBLE:g} standard deviations; lowest: {shown[0]}"
        )
    message = f"negative, which is impossible: {', '.join(negative)}. Possible causes: {_SHAPES}"
    return Check("physical parameters", False, message)


def _nothing_holds_it(posterior: Posterior) -> Check:
    """Test that nothing holds the trunk back: where a tether is attached, and what else it does, is not known."""
    if not posterior.unknowns.estimates("tether_stiffness"):
        return Check("tether", True, "no tether is allowed for")
    ((_, stiffness, std),) = posterior.of_row(posterior.unknowns.priors.row("tether_stiffness"))
    if stiffness < _HELD_BACK * std:
        limit = f"below {_HELD_BACK:g} standard deviations of its stiffness"
        return Check("tether", True, f"nothing is seen to hold the trunk back: {stiffness:+.1f} N/m, {limit}")
    message = (
        f"a hose or a tether holds the trunk back with {stiffness:.1f} N/m (standard deviation {std:.1f}): take it off, "
        "or let it hang slack"
    )
    return Check("tether", False, message)


def _torques_carry_the_mass(posterior: Posterior, masses: MassComparison | None) -> Check:
    """The joint torques must balance, with gains that do not all err to one side: that is how a wrong mass looks."""
    balance = posterior.problem.equation(TorqueBalance)
    if balance is None:
        return Check("torque-mass consistency", True, "no joint torques to compare a scale with")
    unknowns, normalized_residual = posterior.unknowns, balance.normalized_residual
    gains = unknowns["torque_gain"]
    if not unknowns.estimates("torque_gain"):
        message = f"joint torques balance to {normalized_residual:.1f} times their noise; the motors' gains are held"
        return Check("torque-mass consistency", normalized_residual < _TORQUE_MISFIT, message)
    # The best estimate of an error that all gains have in common. An estimated gain is drawn to zero as far as the run does
    # not tell it (most joints of a standing robot carry little), and by chance has the variance that the run took away.
    mean, before = unknowns.believed("torque_gain")
    told = float((before - posterior.covariance[gains, gains]).sum())
    if unknowns.belief is not None:  # what half a minute adds may be less than rounding
        told = max(told, _TOLD)
    common = float((posterior.x[gains] - mean).sum())
    size = abs(common) / float(np.sqrt(told))
    off = common / told * unknowns.priors.torque_gain
    compared = "" if masses is None else f"{masses.message}; "
    carried, balanced = (
        f"the mass of {posterior.robot_body.mass:.2f} kg",
        f"balance to {normalized_residual:.1f} times their noise",
    )
    agree = masses is None or not masses.disagrees
    if agree and size < _IMPLAUSIBLE and normalized_residual < _TORQUE_MISFIT:
        message = (
            f"joint torques carry {carried} with gains {off:+.1%} off ({size:.1f} standard deviations), and {balanced}"
        )
        return Check("torque-mass consistency", True, compared + message)
    message = (
        f"joint torques would have to be {off:+.1%} off to carry {carried} ({size:.1f} standard deviations), and {balanced}. "
        f"The given mass is wrong, the reported torques are not those of the joints in Nm, or {_OUTSIDE}"
    )
    return Check("torque-mass consistency", False, compared + message)


def _left_and_right_agree(posterior: Posterior) -> Check:
    """Legs of a mirrored pair are built alike: what is found of their links must agree within its intervals."""
    unknowns = posterior.unknowns
    if not unknowns.estimates("leg_mass"):
        return Check("left and right", True, "the legs' masses are held at the file's")
    links = len(unknowns.robot.legs["FL"].joint_ids)
    block = posterior.covariance[unknowns["leg_mass"], unknowns["leg_mass"]]
    worst, name = 0.0, ""
    for left, right in ((0, 1), (2, 3)):
        for link in range(links):
            a, b = left * links + link, right * links + link
            difference = float(posterior.x[unknowns["leg_mass"]][a] - posterior.x[unknowns["leg_mass"]][b])
            # Two legs may differ by what the prior allows each, less what is not known of the difference.
            allowed = float(np.sqrt(max(2.0 - (block[a, a] + block[b, b] - 2 * block[a, b]), 0.05)))
            if abs(difference) / allowed > worst:
                worst, name = abs(difference) / allowed, ("front" if left == 0 else "rear") + f" link {link + 1}"
    passed = worst < _LEGS_DIFFER
    message = f"left and right legs differ most in the mass of {name or 'no link'}: {worst:.1f} times what is usual"
    return Check("left and right", passed, f"they agree; {message}" if passed else message)


def _planes_agree(posterior: Posterior) -> Check:
    """The same lifts read another way: where their support planes meet."""
    robot, stance = posterior.unknowns.robot, posterior.unknowns.stance
    lifts = [motion.lift for motion in posterior.motions if motion.lift is not None]
    reading = com_by_planes(robot, composite_parameters(robot, stance.joint_position).com, lifts)
    if reading is None:
        return Check("support planes", True, "too few lifts to tell where their support planes meet")
    off = reading.com - posterior.robot_body.com
    x, y, z = 1000 * off
    planar, height = (stance.scale.length * limit for limit in _PLANES_AGREE)
    passed = np.hypot(*off[:2]) < planar and abs(off[2]) < height
    message = (
        f"the support planes of {len(lifts)} lifts, read without sensor biases, meet {x:+.1f} {y:+.1f} {z:+.1f} mm from the "
        f"centre of mass found; up to {1000 * planar:.0f} mm in the plane and {1000 * height:.0f} mm in height are usual"
    )
    return Check("support planes", bool(passed), message)
