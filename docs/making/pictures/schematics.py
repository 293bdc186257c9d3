"""Pictures of geometry, from the model of the built-in A1."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Arc, Circle, FancyArrowPatch, Polygon
from scipy.spatial import ConvexHull
from style import BLUE, FAINT, GREEN, INK, MUTED, ORANGE, PAPER, bare, draw_com, new_figure, turned

from equipoise import load_robot, nominal_stance
from equipoise.robot.inertial import composite_parameters
from equipoise.robot.kinematics import Kinematics, inverse_kinematics
from equipoise.robot.model import DIAGONALS, LEG_NAMES

_VIEW = (-116.0, 21.0)
_TRUNK = np.array([0.155, 0.066, 0.055])  # half a box about an A1's trunk [m]


def draw_lift() -> Figure:
    """An A1 on two feet, seen from its right, with the support line and its CoM."""
    robot = load_robot("unitree_a1")
    stance = nominal_stance(robot)
    feet = np.array(stance.feet_in_base)
    standing = [LEG_NAMES.index(leg) for leg in DIAGONALS["FL_RR"]]
    feet[[k for k in range(4) if k not in standing], 2] += 0.055
    joints = inverse_kinematics(robot, feet, stance.joint_position)
    com = composite_parameters(robot, joints).com + [0.05, 0.0, 0.0]  # far enough to be seen
    floor = float(feet[standing, 2].mean()) - robot.legs["FL"].foot_radius
    figure = new_figure(6.2, 4.3)
    axes = bare(figure.add_subplot())
    _draw_floor(axes, floor)
    line = np.array([[*feet[k, :2], floor] for k in standing])
    ends = line + np.outer([0.34, -0.34], line[0] - line[1])
    axes.plot(*turned(ends, *_VIEW).T, color=BLUE, linewidth=2.6, zorder=3)
    along = (line[0] - line[1]) / np.linalg.norm(line[0] - line[1])
    across = np.cross(along, [0.0, 0.0, 1.0])
    below = np.array([com[0], com[1], floor])
    nearest = line[1] + along * float((below - line[1]) @ along)
    axes.plot(*turned(np.array([com, below]), *_VIEW).T, color=ORANGE, linewidth=1.2, linestyle=(0, (3, 3)), zorder=8)
    axes.plot(*turned(np.array([nearest, below]), *_VIEW).T, color=ORANGE, linewidth=2.6, zorder=4)
    points = joint_points(robot, joints)
    for leg, name in sorted(enumerate(LEG_NAMES), key=lambda item: -points[item[0], 0, 1]):
        near = name.endswith("R")
        chain = turned(points[leg], *_VIEW)
        axes.plot(*chain.T, color=INK, linewidth=5.5 if near else 4.5, zorder=7 if near else 4.5,
                  solid_joinstyle="round", alpha=1.0 if near else 0.55)  # fmt: skip
        colour = BLUE if leg in standing else MUTED
        axes.add_patch(Circle(chain[-1], 0.018, facecolor=colour, edgecolor=PAPER, linewidth=1, zorder=7.5))
    _draw_trunk(axes)
    draw_com(axes, *turned(com, *_VIEW)[0], 0.021)
    start, end = turned(np.array([com + [0, 0, 0.1], com + [0, 0, 0.06] + 0.19 * across]), *_VIEW)
    axes.add_patch(FancyArrowPatch(start, end, connectionstyle="arc3,rad=-0.3", arrowstyle="-|>", mutation_scale=16,
                                   color=ORANGE, linewidth=2, zorder=9))  # fmt: skip
    _label(axes, turned(ends[0], *_VIEW)[0], (5, 5), "support line", BLUE, "left")
    _label(axes, end, (17, 1), "tips to the side\nof the CoM", ORANGE, "left")
    axes.margins(0.02)
    return figure


def joint_points(robot, joints) -> np.ndarray:
    """(4, 4, 3) hip, thigh and calf joints and foot of each leg, in the base frame [m]."""
    kinematics = Kinematics(robot)
    poses, feet = kinematics.joint_poses(joints), kinematics.foot_positions(joints)
    return np.array(
        [
            [*(poses[joint].translation for joint in robot.legs[leg].joint_ids), feet[k]]
            for k, leg in enumerate(LEG_NAMES)
        ]
    )


def _draw_floor(axes, floor: float) -> None:
    for at in np.linspace(-0.4, 0.4, 9):
        for ends in ([[at, -0.32, floor], [at, 0.32, floor]], [[-0.4, at * 0.8, floor], [0.4, at * 0.8, floor]]):
            axes.plot(*turned(np.array(ends), *_VIEW).T, color=FAINT, linewidth=0.8, zorder=1)


def _draw_trunk(axes) -> None:
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * _TRUNK
    flat = turned(corners, *_VIEW)
    outline = flat[ConvexHull(flat).vertices]
    axes.add_patch(Polygon(outline, facecolor=PAPER, edgecolor=INK, linewidth=1.6, joinstyle="round", zorder=6))
    for a, b in (((-1, -1, 1), (-1, 1, 1)), ((-1, -1, 1), (1, -1, 1)), ((-1, -1, 1), (-1, -1, -1))):
        axes.plot(*turned(np.array([a, b]) * _TRUNK, *_VIEW).T, color=INK, linewidth=0.9, zorder=6.1)


def _label(axes, at, shift, words: str, colour: str, side: str) -> None:
    axes.annotate(words, at, shift, textcoords="offset points", color=colour, ha=side, va="center", fontsize=10,
                  zorder=10)  # fmt: skip


def draw_tilt() -> Figure:
    """The robot seen along its support line: an inverted pendulum."""
    figure = new_figure(6.6, 3.5)
    axes = bare(figure.add_subplot())
    lean, height, radius = np.radians(13), 1.0, 0.09
    axes.plot([-1.5, 1.9], [0, 0], color=MUTED, linewidth=1.2)
    axes.add_patch(Circle((0, radius), radius, facecolor=PAPER, edgecolor=BLUE, linewidth=2, zorder=5))
    axes.plot(0, 0, "o", color=BLUE, markersize=6, zorder=6)
    com = np.array([np.sin(lean), np.cos(lean)]) * height
    axes.plot([0, 0], [0, 1.28], color=FAINT, linewidth=1.2, linestyle=(0, (4, 3)))
    axes.plot([0, com[0]], [0, com[1]], color=INK, linewidth=1.4)
    body = np.array([[-0.62, -0.13], [0.62, -0.13], [0.62, 0.13], [-0.62, 0.13]])
    turn = np.array([[np.cos(lean), np.sin(lean)], [-np.sin(lean), np.cos(lean)]])
    axes.add_patch(Polygon(com + body @ turn.T, facecolor="none", edgecolor=INK, linewidth=1.4, joinstyle="round"))
    draw_com(axes, *com, 0.06)
    axes.annotate("", com + [0, -0.62], com, arrowprops={"arrowstyle": "-|>", "color": ORANGE, "linewidth": 1.8})
    axes.add_patch(Arc((0, 0), 1.0, 1.0, theta1=90 - np.degrees(lean), theta2=90, color=GREEN, linewidth=1.6))
    _label(axes, com + [0, -0.5], (8, 0), "M g: the only moment about l", ORANGE, "left")
    _label(axes, (-radius, 0.3), (-8, -6), "l comes out of the page;\nthe foot rolls on its radius ρ", BLUE, "right")
    _label(axes, (0.03, 0.62), (3, 0), "θ", GREEN, "left")
    _label(axes, com + [-0.5, 0.42], (0, 0), "measured: the angular momentum l · L", INK, "center")
    axes.annotate("", (0.4, -0.16), (0, -0.16), arrowprops={"arrowstyle": "-|>", "color": MUTED, "linewidth": 1.2})
    _label(axes, (0.4, -0.16), (4, 0), "n, forward", MUTED, "left")
    axes.set_xlim(-1.6, 2.1)
    axes.set_ylim(-0.3, 1.6)
    return figure


def draw_planes() -> Figure:
    """Support planes: those of level lift trials share a vertical line, those of leaning postures meet in a point."""
    figure = new_figure(7.4, 3.3)
    for place, (leans, title) in enumerate((((0.0,), "level: height not determined"),
                                            ((-15.0, 0.0, 15.0), "leaning: one point"))):  # fmt: skip
        axes = bare(figure.add_subplot(1, 2, 1 + place))
        axes.set_title(title, color=INK)
        axes.add_patch(
            Polygon([[-1, -0.28], [1, -0.28], [1, 0.28], [-1, 0.28]], facecolor="none", edgecolor=INK, linewidth=1.4)
        )
        com = np.array([0.22, 0.06])
        for degrees in leans:
            up = np.array([np.sin(np.radians(degrees)), np.cos(np.radians(degrees))])
            ends = np.array([com - 1.05 * up, com + 0.75 * up])
            side = 0.035 * np.array([up[1], -up[0]])
            band = np.array([ends[0] - side, ends[0] + side, ends[1] + side, ends[1] - side])
            axes.add_patch(Polygon(band, facecolor=BLUE, alpha=0.22, linewidth=0))
            axes.plot(*ends.T, color=BLUE, linewidth=1.6)
        if place == 0:
            for z in (-0.75, -0.35, 0.06, 0.45):
                draw_com(axes, com[0], z, 0.06)
        else:
            draw_com(axes, *com, 0.06)
        _label(axes, (com[0], -0.99), (8, 0) if place == 0 else (52, 0), "support plane", BLUE, "left")
        axes.set_xlim(-1.15, 1.5)
        axes.set_ylim(-1.1, 0.95)
    return figure


def draw_frames() -> Figure:
    """Frames of base and IMU, feet, CoM, stance and support line of an A1, in perspective and from above."""
    robot = load_robot("unitree_a1")
    stance = nominal_stance(robot)
    feet = np.array(stance.feet_in_base)
    floor = float(feet[:, 2].mean()) - robot.legs["FL"].foot_radius
    contacts = np.column_stack([feet[:, :2], np.full(4, floor)])
    com = composite_parameters(robot, stance.joint_position).com + [0.05, -0.03, 0.0]  # far enough to be seen
    figure = new_figure(8.6, 4.4)
    left, right = figure.subplots(1, 2, width_ratios=[1.35, 1.0])
    _draw_frames_in_space(bare(left), robot, stance, contacts, com)
    _draw_frames_from_above(bare(right), contacts, com)
    return figure


def _draw_frames_in_space(axes, robot, stance, contacts: np.ndarray, com: np.ndarray) -> None:
    floor = contacts[0, 2]
    _draw_floor(axes, floor)
    axes.set_title("nominal stance", color=INK)
    points = joint_points(robot, stance.joint_position)
    for leg, name in sorted(enumerate(LEG_NAMES), key=lambda item: -points[item[0], 0, 1]):
        near = name.endswith("R")
        chain = turned(points[leg], *_VIEW)
        axes.plot(*chain.T, color=MUTED, linewidth=4.5, zorder=4, solid_joinstyle="round", alpha=0.9 if near else 0.45)
        standing = name in DIAGONALS["FL_RR"]
        axes.add_patch(Circle(chain[-1], 0.018, facecolor=BLUE if standing else MUTED, edgecolor=PAPER, zorder=7.5))
        _label(axes, chain[-1], (14 if near else -14, -4), name, INK, "center")
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * _TRUNK
    flat = turned(corners, *_VIEW)
    axes.add_patch(Polygon(flat[ConvexHull(flat).vertices], facecolor=PAPER, edgecolor=INK, alpha=0.8, zorder=6))
    line = contacts[[LEG_NAMES.index(leg) for leg in DIAGONALS["FL_RR"]]]
    ends = line + np.outer([0.25, -0.25], line[0] - line[1])
    axes.plot(*turned(ends, *_VIEW).T, color=BLUE, linewidth=2.4, zorder=3)
    _label(axes, turned(ends[0], *_VIEW)[0], (6, 6), "support line", BLUE, "left")
    base, imu = np.zeros(3), np.array([-0.09, -0.03, -0.03])  # the IMU of the file is at the origin: moved, to be seen
    _draw_axes(axes, base, 0.2, GREEN, "base")
    _draw_axes(axes, imu, 0.06, INK, "IMU")
    draw_com(axes, *turned(com, *_VIEW)[0], 0.017)
    _label(axes, turned(com, *_VIEW)[0], (9, -5), "CoM", ORANGE, "left")
    axes.margins(0.06)


def _draw_axes(axes, origin: np.ndarray, length: float, colour: str, name: str) -> None:
    at = turned(origin, *_VIEW)[0]
    for direction, words in zip(np.eye(3), ("x", "y", "z"), strict=True):
        end = turned(origin + length * direction, *_VIEW)[0]
        axes.add_patch(FancyArrowPatch(at, end, arrowstyle="-|>", mutation_scale=9, color=colour, linewidth=1.6,
                                       shrinkA=0, shrinkB=0, zorder=8))  # fmt: skip
        _label(axes, end + 0.018 * (end - at) / np.linalg.norm(end - at), (0, 0), words, colour, "center")
    axes.plot(*at, "o", color=colour, markersize=4, zorder=8.5)
    _label(axes, at, (15, 13) if name == "base" else (0, -10), name, colour, "center")


def _draw_frames_from_above(axes, contacts: np.ndarray, com: np.ndarray) -> None:
    """Forward is up, left is left."""
    axes.set_title("from above", color=INK)

    def seen(points) -> np.ndarray:
        x, y = np.atleast_2d(points)[:, 0], np.atleast_2d(points)[:, 1]
        return np.column_stack([-y, x])

    corners = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]]) * _TRUNK[:2]
    axes.add_patch(Polygon(seen(corners), facecolor="none", edgecolor=FAINT, linewidth=1.6))
    for diagonal, colour, style in (("FR_RL", MUTED, (0, (4, 3))), ("FL_RR", BLUE, "-")):
        line = contacts[[LEG_NAMES.index(leg) for leg in DIAGONALS[diagonal]]]
        ends = line + np.outer([0.22, -0.22], line[0] - line[1])
        axes.plot(*seen(ends).T, color=colour, linewidth=2.2, linestyle=style)
        side = "right" if diagonal == "FL_RR" else "left"
        _label(axes, seen(ends[0])[0], (0, 9), diagonal, colour, side)
    for name, contact in zip(LEG_NAMES, contacts, strict=True):
        at = seen(contact)[0]
        axes.add_patch(
            Circle(at, 0.014, facecolor=BLUE if name in DIAGONALS["FL_RR"] else MUTED, edgecolor=PAPER, zorder=5)
        )
        _label(axes, at, (-12 if name.endswith("L") else 12, 0), name, INK, "right" if name.endswith("L") else "left")
    line = contacts[LEG_NAMES.index("FL")] - contacts[LEG_NAMES.index("RR")]
    along = line / np.linalg.norm(line)
    across = np.cross(along, [0.0, 0.0, 1.0])
    start = contacts[LEG_NAMES.index("RR")] + 0.1 * line
    for direction, words in ((along, "l"), (across, "n")):
        end = seen(start + 0.085 * direction)[0]
        axes.add_patch(FancyArrowPatch(seen(start)[0], end, arrowstyle="-|>", mutation_scale=11, color=BLUE, linewidth=2,
                                       shrinkA=0, shrinkB=0, zorder=6))  # fmt: skip
        _label(axes, end, (10, 6) if words == "l" else (9, 3), words, BLUE, "center")
    for direction, words in (([1.0, 0.0], "x"), ([0.0, 1.0], "y")):
        end = seen(0.11 * np.array(direction))[0]
        axes.add_patch(FancyArrowPatch((0, 0), end, arrowstyle="-|>", mutation_scale=9, color=GREEN, linewidth=1.6,
                                       shrinkA=0, shrinkB=0, zorder=6))  # fmt: skip
        _label(axes, 1.14 * end, (0, 0), words, GREEN, "center")
    _label(axes, (0, 0), (-16, -9), "base", GREEN, "right")
    draw_com(axes, *seen(com)[0], 0.013)
    _label(axes, seen(com)[0], (9, 0), "CoM", ORANGE, "left")
    axes.margins(0.12)
