"""Pictures of simulated calibrations, which are run for them."""

from functools import cache

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from style import BLUE, FAINT, GREEN, INK, MUTED, ORANGE, draw_com, new_figure

from equipoise import BayesianMethod, calibrate, find_payload_change, load_robot, nominal_stance, simulate
from equipoise.bayesian.routine import plan_ahead
from equipoise.figures.plan_view import plan_view
from equipoise.method.table import method_named
from equipoise.robot.model import DIAGONALS

_PAYLOAD = "1,0.05,0.02,0.08"
_COLOURS = dict(zip(DIAGONALS, (BLUE, GREEN), strict=True))


@cache
def _robot():
    return load_robot("unitree_a1")


@cache
def _run(
    method: str, payload: str | None = _PAYLOAD, budget: float | None = None, seed: int = 3, mass: float | None = None
):
    """A calibration, its recordings, and what was drawn for the simulated sensors."""
    settings = BayesianMethod(budget, mass=mass) if method == "bayesian" else method_named(method)()
    recordings = []
    with simulate(_robot(), "realistic", payload, seed=seed) as simulation:
        result = calibrate(simulation.platform, _robot(), settings, keep=recordings.append).with_truth(simulation.truth)
    return result, recordings, simulation.errors


def draw_result() -> Figure:
    """What `make demo` finds: lines of all lifts around the CoM, and each number against its interval."""
    result = _run("bayesian", mass=13.4)[0]
    figure = new_figure(8.2, 3.7)
    left, right = figure.subplots(1, 2, width_ratios=[1.0, 1.25])
    view = plan_view({result.robot: result})
    for line in view.lifts:
        ends = 1000 * line.piece(view.centre, 0.04)
        left.plot(ends[:, 1], ends[:, 0], color=_COLOURS[line.diagonal], linewidth=0.9, alpha=0.5)
    places = {mark.kind: 1000 * mark.position for mark in view.marks}
    (ellipse,) = (1000 * mark.ellipse for mark in view.found)
    x, y = places["found"]
    left.fill(ellipse[:, 1], ellipse[:, 0], facecolor=ORANGE, alpha=0.25, zorder=8)
    draw_com(left, y, x, 0.45)
    for kind, words in (("truth", "truth"), ("model", "model file")):
        at = places[kind]
        left.plot(at[1], at[0], "x", color=INK, markersize=7, mew=1.8, zorder=10)
        left.annotate(words, (at[1], at[0]), (8, -2), textcoords="offset points", fontsize=9, va="center", color=INK)
    left.set_aspect("equal")
    left.set_xlim(y + 7, y - 7)
    left.set_ylim(x - 7, x + 7)
    left.set_title(f"{len(view.lifts)} lifts, seen from above [mm]")
    left.grid()
    _draw_numbers(right, [*result.composite][:7])
    return figure


def _draw_numbers(axes, quantities) -> None:
    """Estimates with their intervals and the file's values, less the truth, in half intervals."""
    for row, one in enumerate(quantities):
        axes.plot(
            [one.error / one.half_width - 1, one.error / one.half_width + 1],
            [row, row],
            color=ORANGE,
            linewidth=6,
            alpha=0.3,
        )
        axes.plot(
            one.error / one.half_width,
            row,
            "o",
            color=ORANGE,
            markersize=5,
            label="estimate, 95 % interval" if not row else "",
        )
        axes.plot((one.model - one.truth) / one.half_width, row, "D", color=MUTED, mfc="none", markersize=6,
                  label="model file" if not row else "")  # fmt: skip
    axes.axvline(0, color=INK, linewidth=1)
    axes.set_yticks(range(len(quantities)), [one.name.replace("com_", "CoM ") for one in quantities])
    axes.tick_params(axis="y", length=0)
    axes.invert_yaxis()
    axes.set_xlabel("error over the half-width of the 95 % interval")
    axes.set_title("Estimate and model file")
    axes.spines["left"].set_visible(False)
    axes.legend(loc="lower left")


def draw_bisection() -> Figure:
    """Algorithm 1 and 2 on a simulated A1: the brackets close, and two lines cross."""
    result, _, _ = _run("paper")
    figure = new_figure(7.8, 3.5)
    left, right = figure.subplots(1, 2, width_ratios=[1.25, 1.0])
    lifts = [trial for trial in result.trials if trial.kind == "lift"]
    for diagonal, colour in _COLOURS.items():
        chosen = [trial for trial in lifts if trial.about == diagonal]
        bounds = [-60.0 * nominal_stance(_robot()).scale.length, 60.0 * nominal_stance(_robot()).scale.length]
        for number, trial in enumerate(chosen, 1):
            offset = 1000 * trial.offset
            forward = trial.verdict == "forward"
            left.plot(number, offset, "^" if forward else "v", color=colour, markersize=7)
            bounds[0 if forward else 1] = offset
            left.plot([number, number], bounds, color=colour, linewidth=5, alpha=0.16, solid_capstyle="butt")
        left.plot([], [], "^", color=colour, label=f"on {diagonal.replace('_', ' and ')}")
    left.set_title("The bracket closes")
    left.set_xlabel("lift")
    left.xaxis.set_major_locator(MaxNLocator(integer=True))
    left.set_ylabel("offset of the support line [mm]")
    left.set_ylim(-42, 42)
    left.grid(axis="y")
    left.legend(loc="lower right")
    left.annotate("▲ tipped forward: the CoM is ahead\n▼ tipped backward", (0.98, 0.97), xycoords="axes fraction",
                  ha="right", va="top", fontsize=9, color=MUTED)  # fmt: skip
    _draw_crossing(right, result)
    return figure


def _draw_crossing(axes, result) -> None:
    view = plan_view({result.robot: result})
    (found,) = (1000 * mark.position for mark in view.found)
    for line in view.support_lines:
        ends = 1000 * line.piece(view.centre, 0.030)
        axes.plot(ends[:, 1], ends[:, 0], color=_COLOURS[line.diagonal])
    looks = {"truth": (INK, -9), "model": (MUTED, 9)}
    for mark in view.marks:
        if mark.kind in looks:
            at, (colour, shift) = 1000 * mark.position, looks[mark.kind]
            axes.plot(at[1], at[0], "x", color=colour, markersize=8, mew=2, zorder=10)
            axes.annotate(mark.label, (at[1], at[0]), (shift, 0), textcoords="offset points", color=colour, fontsize=9,
                          va="center", ha="right" if shift < 0 else "left")  # fmt: skip
    draw_com(axes, found[1], found[0], 0.55)
    axes.set_aspect("equal")
    half = 9.0
    axes.set_xlim(found[1] + half, found[1] - half)
    axes.set_ylim(found[0] - half, found[0] + half)
    axes.set_title("Two lines cross at the CoM")
    axes.set_xlabel("y, left of the base frame [mm]")
    axes.set_ylabel("x, ahead [mm]")
    axes.grid()


def draw_tipping() -> Figure:
    """How the body turned about the support line in lifts at different offsets."""
    result, recordings, _ = _run("paper")
    stance = nominal_stance(_robot())
    left = stance.feet_in_base[0] - stance.feet_in_base[3]
    left = left / np.linalg.norm(left) * np.sign(left[1])
    figure = new_figure(7.4, 2.9)
    axes = figure.add_subplot()
    lifts = [(trial, rec) for trial, rec in zip(result.trials, recordings, strict=False) if trial.kind == "lift"]
    shown = [(trial, rec) for trial, rec in lifts if trial.about == "FL_RR"]
    for trial, recording in shown:
        rest = recording.phase("rest").imu.angular_velocity_in_imu.mean(axis=0)
        start = recording.phase("lift").imu.time[0]
        imu = recording.imu
        chosen = (imu.time >= start - 0.05) & (imu.time <= recording.phase("watch").imu.time[-1])
        time = imu.time[chosen] - start
        angle = np.degrees(
            np.cumsum((imu.angular_velocity_in_imu[chosen] - rest) @ left) * float(np.mean(np.diff(time)))
        )
        colour = ORANGE if trial.verdict == "forward" else BLUE
        axes.plot(time, angle, color=colour, linewidth=1.6)
        above = trial.verdict == "forward"
        axes.annotate(f"{1000 * trial.offset:+.0f} mm", (time[-1], angle[-1]), (0, 4 if above else -4), fontsize=9,
                      textcoords="offset points", color=colour, ha="center", va="bottom" if above else "top")  # fmt: skip
    axes.axhline(0, color=FAINT, linewidth=1)
    axes.margins(x=0.05, y=0.15)
    axes.set_xlabel("time from lift-off [s]")
    axes.set_ylabel("angle about the support line [deg]")
    axes.annotate("forward", (0.01, 0.95), xycoords="axes fraction", color=ORANGE, fontsize=9, va="top")
    axes.annotate("backward", (0.01, 0.05), xycoords="axes fraction", color=BLUE, fontsize=9)
    return figure


def draw_excitation() -> Figure:
    """Equations 3 to 5 on a simulated excitation about yaw."""
    result, _, _ = _run("paper")
    fit = result.evidence.fits["yaw"]
    figure = new_figure(7.6, 2.6)
    contents = (
        ("angular velocity [rad/s]", fit.angular_velocity, fit.sinusoid.value(fit.time), "equation 3"),
        ("torque about the CoM [Nm]", fit.torque, fit.fitted_torque, "equation 5"),
    )
    for axes, (label, measured, fitted, word) in zip(figure.subplots(1, 2), contents, strict=True):
        first = fit.time - fit.time[0] <= 1.6
        axes.plot(fit.time[first], measured[first], color=BLUE, alpha=0.55, linewidth=2.6, label="measured")
        axes.plot(fit.time[first], fitted[first], color=ORANGE, linewidth=1.5, label=word)
        axes.set_xlabel("time [s]")
        axes.set_ylabel(label)
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, 1.2), ncols=2)
        axes.grid(axis="y")
    return figure


def draw_sensors() -> Figure:
    """Joint offsets of the Bayesian method and of the simulated robot."""
    result, _, errors = _run("bayesian")
    names = _robot().joint_names
    figure = new_figure(7.6, 2.9)
    axes = figure.add_subplot()
    places = np.arange(len(names))
    offsets = [result.joints[name].offset for name in names]
    values, half_widths = (
        np.array([getattr(offset, which) for offset in offsets]) for which in ("value", "half_width")
    )
    axes.errorbar(places, np.degrees(values), np.degrees(half_widths), fmt="o", color=BLUE, capsize=4, markersize=5,
                  label="estimate, 95 %")  # fmt: skip
    axes.plot(places, np.degrees(errors.drawn["joint_offset"]), "x", color=ORANGE, mew=2, markersize=7, label="truth")
    axes.axhline(0, color=FAINT, linewidth=1)
    axes.set_xticks(places, [name.replace("_joint", "").replace("_", "\n") for name in names])
    axes.set_ylabel("joint offset [deg]")
    axes.grid(axis="y")
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
    return figure


def draw_plan() -> Figure:
    """Predicted accuracy over the robot time."""
    stance = nominal_stance(_robot())
    budgets = [45, 60, 80, 100, 120, 160, 200]
    plans = [plan_ahead(_robot(), stance, BayesianMethod(budget)) for budget in budgets]
    times = [plan.robot_time for plan in plans]
    figure = new_figure(7.6, 2.8)
    shown = (
        ("centre of mass [mm]", ((1, "x", ORANGE), (2, "y", BLUE), (3, "z", GREEN)), lambda plan, k: 1000 * plan.std[k]),
        ("moments of inertia [%]", ((4, "Ixx", ORANGE), (5, "Iyy", BLUE), (6, "Izz", GREEN)),
         lambda plan, k: 100 * plan.std[k] / plan.body[k]),
    )  # fmt: skip
    for axes, (title, curves, value) in zip(figure.subplots(1, 2), shown, strict=True):
        for index, word, colour in curves:
            axes.plot(
                times, [value(plan, index) for plan in plans], color=colour, marker="o", markersize=3.5, label=word
            )
        axes.set_ylim(0, None)
        axes.set_xlabel("robot time [s]")
        axes.set_title(f"{title}, 1 std")
        axes.grid(axis="y")
        axes.legend(ncols=3)
    return figure


def draw_payload() -> Figure:
    """How sure what was added is: two results less each other, and both runs estimated together."""
    before, first, _ = _run("bayesian", None)
    after, second, _ = _run("bayesian", _PAYLOAD)
    delta = find_payload_change(_robot(), first, second)
    names = ("mass", "com_x", "com_y", "com_z")
    apart = np.hypot(before.composite.stds, after.composite.stds)
    together = delta.change.stds
    figure = new_figure(7.6, 2.5)
    mass, com = figure.subplots(1, 2, width_ratios=[1, 3])
    for axes, chosen, factor, label in ((mass, slice(0, 1), 1000, "[g]"), (com, slice(1, 4), 1000, "[mm]")):
        places = np.arange(len(names[chosen]))
        axes.bar(places - 0.19, factor * apart[chosen], 0.36, color=FAINT, label="difference of two results")
        axes.bar(places + 0.19, factor * together[chosen], 0.36, color=ORANGE, label="estimated together")
        axes.set_xticks(places, [name.replace("com_", "CoM ") for name in names[chosen]])
        axes.set_ylabel(f"standard deviation {label}")
        axes.tick_params(axis="x", length=0)
    com.legend()
    return figure
