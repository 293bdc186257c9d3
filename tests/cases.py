"""Quadruped of 12 kg as URDF or MJCF, and edits that give it defects of public model files."""

import re

HIPS = {"FL": (0.18, 1), "FR": (0.18, -1), "RL": (-0.18, 1), "RR": (-0.18, -1)}
LIMITS = {"hip": (-0.8, 0.8), "thigh": (-1.5, 3.0), "calf": (-2.6, -0.5)}
AXES = {"hip": "1 0 0", "thigh": "0 1 0", "calf": "0 1 0"}
COM_MM, MOMENTS = (-0.36, 0.0, -19.25), (0.1683, 0.3494, 0.3960)
"""CoM and moments of the whole robot at its stance, by Pinocchio."""


def inertial(com, mass, moments):
    xx, yy, zz = moments
    return (
        f'<inertial><origin xyz="{com}"/><mass value="{mass}"/>'
        f'<inertia ixx="{xx}" ixy="0" ixz="0" iyy="{yy}" iyz="0" izz="{zz}"/></inertial>'
    )


def joint(name, parent, child, origin, axis, limits):
    return (
        f'<joint name="{name}" type="revolute"><origin xyz="{origin}"/><parent link="{parent}"/><child link="{child}"/>'
        f'<axis xyz="{axis}"/><limit lower="{limits[0]}" upper="{limits[1]}" effort="20" velocity="20"/></joint>'
    )


def urdf(hip_offset="0 {side}0.08 0", mirrored_axes=False, limits=LIMITS, left_limits=LIMITS, extra=""):
    """Return the robot as URDF. Left axes may be mirrored, with their own limits."""
    parts = [f'<link name="trunk">{inertial("0.02 0 0.01", 6.0, (0.025, 0.085, 0.1))}</link>']
    for leg, (x, side) in HIPS.items():
        sign = "" if side > 0 else "-"
        own = left_limits if side > 0 else limits
        axes = {part: axis.replace("1", "-1") if mirrored_axes and side > 0 else axis for part, axis in AXES.items()}
        links = [
            ("hip", "trunk", f"{x} {sign}0.06 0", f"0 {sign}0.03 0", 0.5, (5.33333333e-4,) * 3),
            ("thigh", f"{leg}_hip", hip_offset.format(side=sign), f"0 {0.01 * -side} -0.04", 0.8,
             (0.00277333333, 0.00277333333, 0.000213333333)),
            ("calf", f"{leg}_thigh", "0 0 -0.2", "0 0 -0.1", 0.15, (5.05e-4, 5.05e-4, 1e-5)),
        ]  # fmt: skip
        for part, parent, origin, com, mass, moments in links:
            parts.append(joint(f"{leg}_{part}_joint", parent, f"{leg}_{part}", origin, axes[part], own[part]))
            parts.append(f'<link name="{leg}_{part}">{inertial(com, mass, moments)}</link>')
        parts.append(
            f'<joint name="{leg}_foot_fixed" type="fixed"><origin xyz="0 0 -0.2"/><parent link="{leg}_calf"/>'
            f'<child link="{leg}_foot"/></joint><link name="{leg}_foot">{inertial("0 0 0", 0.05, (8e-6,) * 3)}'
            '<collision><geometry><sphere radius="0.02"/></geometry></collision></link>'
        )
    return f'<robot name="quad">{"".join(parts)}{extra}</robot>'


def mjcf(trunk='<body name="trunk">{}</body>', hip_joints="", tail="", compiler='angle="radian"'):
    """Return the robot as MJCF; `trunk` holds the legs, `hip_joints` are more joints of the hips' bodies."""
    legs = ""
    for leg, (x, side) in HIPS.items():
        legs += f"""<body name="{leg}_hip" pos="{x} {0.06 * side} 0">
          <inertial pos="0 {0.03 * side} 0" mass="0.5" diaginertia="0.00053 0.00053 0.00053"/>
          <joint name="{leg}_hip_joint" axis="1 0 0" range="-0.8 0.8"/>{hip_joints.format(leg=leg)}
          <body name="{leg}_thigh" pos="0 {0.08 * side} 0">
            <inertial pos="0 {-0.01 * side} -0.04" mass="0.8" diaginertia="0.00277 0.00277 0.000213"/>
            <joint name="{leg}_thigh_joint" axis="0 1 0" range="-1.5 3"/>
            <body name="{leg}_calf" pos="0 0 -0.2">
              <inertial pos="0 0 -0.1" mass="0.15" diaginertia="0.0005 0.0005 0.00001"/>
              <joint name="{leg}_calf_joint" axis="0 1 0" range="-2.6 -0.5"/>
              <geom name="{leg}_foot" type="sphere" size="0.02" pos="0 0 -0.2" mass="0.05"/>
        </body></body></body>"""
    return f"<mujoco><compiler {compiler}/><worldbody>{trunk.format(legs)}</worldbody>{tail}</mujoco>"


FREE = '<body name="trunk"><freejoint/><inertial pos="0.02 0 0.01" mass="6" diaginertia="0.025 0.085 0.1"/>{}</body>'


def scaled(text, pattern, factor):
    """Return the text with every number in the first group of a pattern multiplied."""

    def multiplied(found):
        numbers = " ".join(f"{float(word) * factor:.10g}" for word in found[1].split())
        return found[0].replace(f'"{found[1]}"', f'"{numbers}"')

    return re.sub(pattern, multiplied, text)


def with_coms_times(text, factor, link=r"\w+"):
    return re.sub(
        rf'<link name="{link}">.*?</inertial>', lambda link: scaled(link[0], r'<origin xyz="([^"]*)"', factor), text
    )


def with_inertias_times(text, factor, link=r"\w+"):
    return re.sub(
        rf'<link name="{link}">.*?</inertial>',
        lambda link: scaled(link[0], r'i[xyz]{2}="([^"]*)"', factor),
        text,
    )


def with_limits(text, part, limits):
    """Return the text with other limits of a joint of all legs, as the text of the attributes."""
    return re.sub(rf'(<joint name="\w\w_{part}_joint".*?<limit) lower="[^"]*" upper="[^"]*"', rf"\1 {limits}", text)
