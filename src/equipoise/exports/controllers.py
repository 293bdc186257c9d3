"""Code snippets for controllers, with the names and the order of each controller's own file."""

from __future__ import annotations

from equipoise.exports.subject import COMPOSITE_WORDS, FloatArray, Subject, Written, number


def quadruped_pympc(subject: Subject) -> Written:
    """Write lines for Quadruped-PyMPC: quadruped_pympc/config.py."""
    body = subject.composite
    rows = [f"[{', '.join(map(number, row))}]" for row in body.inertia]
    indent = ",\n" + " " * len("inertia = np.array([")
    lines = [
        "# quadruped_pympc/config.py, after the choice of the robot; needs 'use_inertia_recomputation': False",
        f"mass = {number(body.mass)}",
        f"inertia = np.array([{indent.join(rows)}])",
    ]
    return subject.text(COMPOSITE_WORDS, lines)


def unitree_guide(subject: Subject) -> Written:
    """Write lines for unitree_guide: src/common/unitreeRobot.cpp."""
    body = subject.composite
    lines = [
        "// src/common/unitreeRobot.cpp, in the constructor of the robot",
        f"_mass = {number(body.mass)};",
        f"_pcb << {', '.join(map(number, body.com))};",
        *_matrix("_Ib << ", body.inertia),
    ]
    return subject.text(COMPOSITE_WORDS, lines, mark="// ")


def mit_cheetah(subject: Subject) -> Written:
    """Write lines for Cheetah-Software: RobotState.h, RobotState.cpp (composite) and MiniCheetah.h (base)."""
    whole, base = subject.composite, subject.base
    about = f"{COMPOSITE_WORDS}; in MiniCheetah.h the {subject.base_words}"
    lines = [
        "// user/MIT_Controller/Controllers/convexMPC/RobotState.h: composite",
        f"fpt m = {number(whole.mass)}f;",
        "// user/MIT_Controller/Controllers/convexMPC/RobotState.cpp: composite; for Id and I_body.diagonal()",
        *_matrix("I_body << ", whole.inertia, suffix="f"),
        "// common/include/Dynamics/MiniCheetah.h: base",
        f"cheetah._bodyMass = {number(base.mass)};",
        *_matrix("bodyRotationalInertia << ", base.inertia * 1e6),
        "bodyRotationalInertia = bodyRotationalInertia * 1e-6;",
        f"Vec3<T> bodyCOM({', '.join(map(number, base.com))});",
    ]
    return subject.text(about, lines, mark="// ")


def quad_sdk(subject: Subject) -> Written:
    """Write lines for Quad-SDK: quad_utils/config/ROBOT.yaml, and nmpc_controller/scripts/main.m in a comment."""
    body = subject.composite
    rows = "; ".join(" ".join(map(number, row)) for row in body.inertia)
    lines = [
        "# nmpc_controller/scripts/main.m, before dynamicsModel(parameter); replaces the sums above it:",
        f"#   parameter.physics.mass_body = {number(body.mass)};",
        f"#   parameter.physics.inertia_body = [{rows}];",
        "# quad_utils/config/ROBOT.yaml:",
        "/**/global_body_planner:",
        "  ros__parameters:",
        "    global_body_planner:",
        f"      mass: {number(body.mass)}",
    ]
    return subject.text(COMPOSITE_WORDS, lines)


def _matrix(name: str, rows: FloatArray, suffix: str = "") -> list[str]:
    """Return an Eigen comma initialiser, one line per row."""
    lines = [", ".join(number(value) + suffix for value in row) for row in rows]
    indent = " " * len(name)
    return [f"{name}{lines[0]},", f"{indent}{lines[1]},", f"{indent}{lines[2]};"]
