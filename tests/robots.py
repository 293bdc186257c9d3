"""Small robots as URDF or MJCF text, with properties that no robot of the catalogue has."""

import warnings
from collections.abc import Callable, Sequence

from equipoise.errors import ModelWarning
from equipoise.robot.model import RobotModel

HIPS = {
    "FL": (0.2, 0.1),
    "FR": (0.2, -0.1),
    "ML": (0.0, 0.1),
    "MR": (0.0, -0.1),
    "RL": (-0.2, 0.1),
    "RR": (-0.2, -0.1),
}
FOUR_LEGS = ("FL", "FR", "RL", "RR")
SIX_LEGS = ("FL", "FR", "ML", "MR", "RL", "RR")
THIGH = SHANK = 0.2
FOOT_RADIUS = 0.02
# A leg's links, hip down: mass [kg], CoM [m], Ixx Iyy Izz Ixy Ixz Iyz about it [kg m2]. No plane of symmetry.
LINKS = (
    (0.7, (-0.003, 0.01, 0.002), (5e-4, 8e-4, 6e-4, 1e-5, -2e-5, 3e-5)),
    (1.0, (-0.004, 0.02, -0.03), (5.5e-3, 5.1e-3, 1.4e-3, -5e-5, 3e-4, -2e-4)),
    (0.2, (0.006, 0.001, -0.11), (3e-3, 3.1e-3, 2e-4, 1e-5, -1.4e-4, 2e-5)),
)
TRUNK = (0.01, 0.002, 0.005), (0.02, 0.06, 0.065, 1e-4, 6e-4, 3e-5)
ARM = (0.4, (0.02, -0.01, 0.05), (1e-3, 1.2e-3, 4e-4, 2e-5, -3e-5, 1e-5))
REAR_TRUNK = (1.5, (-0.05, 0.003, 0.01), (4e-3, 5e-3, 6e-3, 1e-4, 2e-4, -1e-4))

JointName = Callable[[str, int], str]


def plain_name(leg: str, joint: int) -> str:
    """Return the name of a joint: FL_0 is the front left leg's uppermost one."""
    return f"{leg}_{joint}"


def quadruped_urdf(
    legs: Sequence[str] = FOUR_LEGS,
    joints_per_leg: int = 3,
    joint_name: JointName = plain_name,
    *,
    trunk: str = "trunk",
    trunk_mass: str | float = 6.0,
    arm_joints: int = 0,
    arm_type: str = "revolute",
    spine: bool = False,
    world: bool = False,
    continuous: bool = False,
    knee_range: tuple[float, float] = (-2.7, 2.7),
    foot_radius: float | None = FOOT_RADIUS,
    foot_links: bool = True,
    extra: str = "",
) -> str:
    """Return a URDF of a robot with point feet, 0.4 m long legs and a 0.4 m x 0.2 m base.

    Args:
        legs: names, of `HIPS`, in the order of the file; three or six are not a quadruped.
        joints_per_leg: 3, or 2 without abduction.
        joint_name: name of a leg's joint by leg and place, 0 at the hip.
        trunk: name of the base link; trunk_mass may be any text.
        arm_joints: number of joints of an arm on the trunk's front; arm_type is their type.
        spine: whether the rear legs are on a second trunk, behind a joint.
        world: whether the file starts at a massless link that the trunk is fixed to.
        continuous: whether hip pitch joints are continuous ones.
        foot_radius: radius of the sphere at each foot; None: no sphere.
        foot_links: whether there is a link at each foot.
        extra: more XML before the end.
    """
    parts = []
    if world:
        parts += ['<link name="world"/>', _urdf_joint("fix_base", "fixed", "world", trunk, (0.0, 0.0, 0.5))]
    parts.append(f'<link name="{trunk}">{_urdf_inertial(trunk_mass, *TRUNK)}</link>')
    if spine:
        parts.append(f'<link name="rear_trunk">{_urdf_inertial(*REAR_TRUNK)}</link>')
        parts.append(_urdf_joint("spine", "revolute", trunk, "rear_trunk", (-0.05, 0.0, 0.0), (0, 0, 1), (-0.5, 0.5)))
    for leg in legs:
        at_rear = spine and leg in ("RL", "RR")
        parts += _urdf_leg(
            leg, joints_per_leg, joint_name, "rear_trunk" if at_rear else trunk, 0.05 if at_rear else 0.0,
            continuous, knee_range, foot_radius, foot_links,
        )  # fmt: skip
    parent, origin, rpy = trunk, (0.1, 0.01, 0.08), "0.3 -0.2 0.4"
    for place in range(arm_joints):
        parts.append(f'<link name="arm_link_{place}">{_urdf_inertial(*ARM)}</link>')
        axis = (0, 1, 0) if place % 2 == 0 else (0, 0, 1)
        parts.append(
            _urdf_joint(f"arm_{place}", arm_type, parent, f"arm_link_{place}", origin, axis, (-1.5, 1.5), rpy=rpy)
        )
        parent, origin, rpy = f"arm_link_{place}", (0.0, 0.02, 0.15), "0 0.1 0"
    return "\n".join(['<robot name="synthetic">', *parts, extra, "</robot>"])


def on_cylinders(rpy: str = "1.5708 0 0") -> str:
    """Return a URDF with feet of 36 x 12 mm cylinders, rotated from the foot link's z axis by angles [rad]; across the leg."""
    shape = '<geometry><cylinder radius="0.018" length="0.012"/></geometry>'
    ball = f'<geometry><sphere radius="{FOOT_RADIUS}"/></geometry>'
    return quadruped_urdf().replace(ball, f'<origin rpy="{rpy}"/>{shape}')


def urdf_arm_on_a_mount(trunk: str = "trunk") -> str:
    """Return `extra` of a URDF: an arm on a rotated mount, with a rotated fixed link and a gripper of two fingers."""
    chain = [
        ("mount", "fixed", trunk, (0.12, 0.01, 0.07), "0.2 -0.3 0.5", None),
        ("upper", "revolute", "mount", (0.02, -0.01, 0.04), "0.1 0.2 -0.4", (0, 1, 0)),
        ("elbow", "fixed", "upper", (0.15, 0.0, 0.03), "-0.3 0.4 0.2", None),
        ("lower", "revolute", "elbow", (0.02, 0.03, 0.0), "0.5 0 0.1", (0, 0, 1)),
        ("gripper", "fixed", "lower", (0.1, 0.0, 0.01), "0 0.7 0", None),
        ("left_finger", "prismatic", "gripper", (0.03, 0.02, 0.0), "0.3 0 0", (0, 1, 0)),
        ("right_finger", "prismatic", "gripper", (0.03, -0.02, 0.0), "0 0 0.3", (0, -1, 0)),
    ]
    parts = []
    for place, (link, kind, parent, origin, rpy, axis) in enumerate(chain):
        mass, com, inertia = ARM
        parts.append(f'<link name="{link}">{_urdf_inertial(mass + 0.1 * place, com, inertia)}</link>')
        limits = None if axis is None else (-1.5, 1.5)
        parts.append(_urdf_joint(f"to_{link}", kind, parent, link, origin, axis or (1, 0, 0), limits, rpy))
    return "".join(parts)


def mjcf_arm_on_a_mount() -> str:
    """Return `trunk_extra` of an MJCF: the arm of `urdf_arm_on_a_mount`, with joints off their bodies' origins."""
    masses = [_mjcf_inertial(ARM[0] + 0.1 * place, *ARM[1:]) for place in range(7)]
    return (
        f'<body name="mount" pos="0.12 0.01 0.07" euler="0.2 -0.3 0.5">{masses[0]}'
        f'<body name="upper" pos="0.02 -0.01 0.04" euler="0.1 0.2 -0.4"><joint name="to_upper" axis="0 1 0"/>{masses[1]}'
        f'<body name="elbow" pos="0.15 0 0.03" euler="-0.3 0.4 0.2">{masses[2]}'
        f'<body name="lower" pos="0.02 0.03 0"><joint name="to_lower" axis="0 0.6 0.8" pos="0.03 0 -0.02"/>{masses[3]}'
        f'<body name="gripper" pos="0.1 0 0.01" euler="0 0.7 0">{masses[4]}'
        f'<body name="left" pos="0.03 0.02 0"><joint name="to_left_finger" type="slide" axis="0 1 0"/>{masses[5]}</body>'
        f'<body name="right" pos="0.03 -0.02 0"><joint name="to_right_finger" type="slide" axis="0 -1 0"/>{masses[6]}</body>'
        "</body></body></body></body></body>"
    )


def _urdf_leg(
    leg: str,
    joints: int,
    joint_name: JointName,
    parent: str,
    shift: float,
    continuous: bool,
    knee_range: tuple[float, float],
    foot_radius: float | None,
    foot_links: bool,
) -> list[str]:
    (x, y), side = HIPS[leg], 1 if HIPS[leg][1] > 0 else -1
    chain = [
        ("revolute", (x + shift, y, 0.0), (1, 0, 0), (-0.9, 0.9)),
        ("continuous" if continuous else "revolute", (0.0, side * 0.08, 0.0), (0, 1, 0), (-2.5, 2.5)),
        ("revolute", (0.0, 0.0, -THIGH), (0, 1, 0), knee_range),
    ]
    if joints == 2:
        chain = [(chain[1][0], (x + shift, y + side * 0.08, 0.0), *chain[1][2:]), chain[2]]
    parts = []
    for place, (kind, origin, axis, limits) in enumerate(chain):
        link = f"{leg}_link_{place}"
        mass, (cx, cy, cz), inertia = LINKS[place + 3 - joints]
        parts.append(f'<link name="{link}">{_urdf_inertial(mass, (cx, side * cy, cz), inertia)}</link>')
        parts.append(_urdf_joint(joint_name(leg, place), kind, parent, link, origin, axis, limits))
        parent = link
    if foot_links:
        sphere = (
            ""
            if foot_radius is None
            else f'<collision><geometry><sphere radius="{foot_radius}"/></geometry></collision>'
        )
        parts.append(f'<link name="{leg}_foot">{sphere}</link>')
        parts.append(_urdf_joint(f"{leg}_foot_joint", "fixed", parent, f"{leg}_foot", (0.0, 0.0, -SHANK)))
    return parts


def _urdf_inertial(mass: str | float, com: Sequence[float], inertia: Sequence[float]) -> str:
    values = " ".join(
        f'{key}="{v}"' for key, v in zip(("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), inertia, strict=True)
    )
    return f'<inertial><origin xyz="{_words(com)}"/><mass value="{mass}"/><inertia {values}/></inertial>'


def _urdf_joint(
    name: str,
    kind: str,
    parent: str,
    child: str,
    origin: Sequence[float] = (0.0, 0.0, 0.0),
    axis: Sequence[float] = (1, 0, 0),
    limits: tuple[float, float] | None = None,
    rpy: str = "0 0 0",
) -> str:
    limit = ""
    if limits is not None:
        bounds = "" if kind == "continuous" else f'lower="{limits[0]}" upper="{limits[1]}" '
        limit = f'<limit {bounds}effort="30" velocity="20"/>'
    return (
        f'<joint name="{name}" type="{kind}"><origin xyz="{_words(origin)}" rpy="{rpy}"/><parent link="{parent}"/>'
        f'<child link="{child}"/><axis xyz="{_words(axis)}"/>{limit}</joint>'
    )


def _words(values: Sequence[float]) -> str:
    return " ".join(map(str, values))


def quadruped_mjcf(
    *,
    free: str = "<freejoint/>",
    attributes: str = 'pos="0 0 0.5"',
    explicit_inertia: bool = True,
    arm: bool = False,
    head: str = '<compiler angle="radian"/>',
    trunk_extra: str = "",
    tail: str = "",
) -> str:
    """Return an MJCF of the default robot of `quadruped_urdf`, without its foot links.

    Args:
        free: XML of the trunk's free joint.
        attributes: attributes of the trunk's body.
        explicit_inertia: whether bodies have an <inertial>; otherwise their shapes determine their mass.
        arm: whether there is an arm of two joints on the trunk, the second one off its body's origin.
        head: sections before <worldbody>; tail: after it.
        trunk_extra: more children of the trunk's body.
    """
    parts = []
    for leg in FOUR_LEGS:
        (x, y), side = HIPS[leg], 1 if HIPS[leg][1] > 0 else -1
        inner = f'<geom name="{leg}_foot" type="sphere" size="{FOOT_RADIUS}" pos="0 0 {-SHANK}" density="1500"/>'
        chain = [
            ((x, y, 0.0), "1 0 0", (-0.9, 0.9), '<geom type="cylinder" size="0.03 0.02" euler="0.2 0.1 0"/>'),
            (
                (0.0, side * 0.08, 0.0),
                "0 1 0",
                (-2.5, 2.5),
                f'<geom type="capsule" size="0.02" fromto="0 0 0 0 0 {-THIGH}"/>',
            ),
            ((0.0, 0.0, -THIGH), "0 1 0", (-2.7, 2.7), '<geom type="box" size="0.02 0.02 0.08" pos="0.01 0 -0.1"/>'),
        ]
        for place in (2, 1, 0):
            origin, axis, (low, high), shape = chain[place]
            mass, (cx, cy, cz), inertia = LINKS[place]
            body = _mjcf_inertial(mass, (cx, side * cy, cz), inertia) if explicit_inertia else shape
            inner = (
                f'<body name="{leg}_link_{place}" pos="{_words(origin)}">'
                f'<joint name="{leg}_{place}" axis="{axis}" range="{low} {high}"/>{body}{inner}</body>'
            )
        parts.append(inner)
    if arm:
        inertial = _mjcf_inertial(*ARM)
        parts.append(
            f'<body name="arm_link_0" pos="0.1 0.01 0.08" euler="0.3 -0.2 0.4"><joint name="arm_0" axis="0 1 0"/>{inertial}'
            f'<body name="arm_link_1" pos="0 0.02 0.15"><joint name="arm_1" axis="0 0.6 0.8" pos="0.03 0.01 -0.02"/>'
            f"{inertial}</body></body>"
        )
    trunk = _mjcf_inertial(6.0, *TRUNK) if explicit_inertia else '<geom type="ellipsoid" size="0.2 0.1 0.06" mass="6"/>'
    return (
        f'<mujoco model="synthetic">{head}<worldbody><body name="trunk" {attributes}>{free}{trunk}{trunk_extra}'
        f"{''.join(parts)}</body></worldbody>{tail}</mujoco>"
    )


def _mjcf_inertial(mass: float, com: Sequence[float], inertia: Sequence[float]) -> str:
    return f'<inertial pos="{_words(com)}" mass="{mass}" fullinertia="{_words(inertia)}"/>'


def load_text(folder, text, description=None, name="robot"):
    """Return the robot of a file with this text, without warnings of repairs."""
    path = folder / name
    path.write_text(text, encoding="utf-8")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        return RobotModel.from_file(path, description=description)
