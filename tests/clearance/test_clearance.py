"""Distances between links: shapes, contacts, and few distance computations without missed contacts."""

import coal
import numpy as np
import pytest
from robots import load_text, quadruped_urdf

from equipoise import nominal_stance
from equipoise.clearance.clearance import FLOOR, Clearance, contact_in
from equipoise.clearance.floor import floor_contact
from equipoise.clearance.pairs import Distances, pairs_of
from equipoise.clearance.shapes import link_of
from equipoise.errors import ReachError
from equipoise.experiments.motion import Target
from equipoise.experiments.posture import check_posture, feet_in_posture
from equipoise.experiments.standing_robot import StandingRobot
from equipoise.method.rehearsal import held_posture
from equipoise.robot.description import RobotDescription
from equipoise.robot.kinematics import Kinematics, foot_positions
from equipoise.robot.posture import BodyPosture
from equipoise.robot.stance import lying_posture


@pytest.fixture(scope="module")
def home(a1):
    return nominal_stance(a1).joint_position


def with_joints(robot, **angles):
    position = nominal_stance(robot).joint_position.copy()
    for name, angle in angles.items():
        position[robot.joint_names.index(name)] = angle
    return position


def way(start, end, count=150):
    return start + np.linspace(0, 1, count)[:, None] * (end - start)


def test_the_standing_and_lying_postures_have_no_contact(a1, home):
    assert contact_in(a1, home) is None
    assert contact_in(a1, lying_posture(a1, nominal_stance(a1))[0]) is None


def test_legs_that_cross_are_named(a1, home):
    crossed = with_joints(a1, FL_hip_joint=-0.45, FR_hip_joint=0.45)
    assert str(contact_in(a1, crossed)) == "link 'FL_foot' would touch link 'FR_foot'"
    clearance = Clearance(a1, home)
    contact = clearance.first_contact(way(home, crossed))
    assert 0 < contact.distance < 5e-3
    assert str(contact) == f"link 'FL_foot' would come within {contact.distance * 1000:.1f} mm of link 'FR_foot'"


@pytest.mark.parametrize("seed", range(4))
def test_no_contact_is_missed(a1, home, seed):
    """The reference checks every posture, on random paths that mostly end in a contact."""
    random = np.random.default_rng(seed)
    pairs = pairs_of(a1)
    target = home + 0.7 * (random.uniform(a1.lower_limit, a1.upper_limit) - home)
    positions = way(home, target)
    distances = Distances(a1, pairs.shapes)
    nearest = np.array([distances.all(position).min() for position in positions])
    gone = 0
    clearance = Clearance(a1, home)
    while gone < len(positions) and clearance.next_contact(positions[gone]) is None:
        gone += 1
    assert (nearest[:gone] > 0).all()
    assert gone == len(positions) or nearest[gone] < pairs.least
    at_once = Clearance(a1, home).first_contact(positions)
    assert (at_once is None) == (gone == len(positions))


def test_few_distances_are_computed(a1, home, monkeypatch):
    clearance, checks = Clearance(a1, home), []
    check = clearance._check_due
    monkeypatch.setattr(clearance, "_check_due", lambda *at: checks.append(at) or check(*at))
    crouched, _ = lying_posture(a1, nominal_stance(a1))
    assert clearance.first_contact(way(home, crouched, 2000)) is None
    assert len(checks) < 150


def test_links_that_touch_initially_may_separate_but_not_come_nearer(a1, home):
    crossed = with_joints(a1, FL_hip_joint=-0.38, FR_hip_joint=0.38)
    assert contact_in(a1, crossed).distance < -0.01
    assert Clearance(a1, crossed).first_contact(way(crossed, home)) is None
    deeper = with_joints(a1, FL_hip_joint=-0.4, FR_hip_joint=0.4)
    assert Clearance(a1, crossed).first_contact(way(crossed, deeper)) is not None
    parted = Clearance(a1, crossed)
    assert parted.first_contact(way(crossed, home)) is None
    assert parted.first_contact(way(home, crossed)).distance > 0


def test_links_without_shapes_get_capsules(skewed):
    shapes = pairs_of(skewed).shapes.geometryObjects
    capsules = [link_of(shape) for shape in shapes if isinstance(shape.geometry, coal.Capsule)]
    assert sorted(name for name in capsules if name.startswith("arm")) == ["arm_link_0", "arm_link_1"]
    assert len(capsules) == 2 + 12
    assert sum(isinstance(shape.geometry, coal.Box) for shape in shapes) == 1


def test_an_arm_with_locked_joints_is_at_its_angles(tmp_path):
    text = quadruped_urdf(arm_joints=2)
    ends = []
    for angle in (0.0, 1.0):
        robot = load_text(tmp_path, text, RobotDescription(locked_joints={"arm_0": angle}))
        arm = [shape for shape in pairs_of(robot).shapes.geometryObjects if link_of(shape).startswith("arm")]
        ends.append(np.array(arm[-1].placement.translation))
    assert np.linalg.norm(ends[1] - ends[0]) > 0.03


class Still:
    """Platform that must not move."""

    control_period = 2e-3

    def play(self, trajectory, stop=None):
        raise AssertionError("it was moved")


def test_a_motion_in_which_links_touch_is_rejected(a1, home):
    stance = nominal_stance(a1)
    standing = StandingRobot(Still(), a1, Target.standing(a1, home), stance.feet_in_base)
    crossed = with_joints(a1, FL_hip_joint=-0.45, FR_hip_joint=0.45)
    with pytest.raises(
        ReachError, match=r"^link 'FL_foot' would come within \d\.\d mm of link 'FR_foot'; the robot was not moved"
    ):
        standing.play(standing.motion().move_joints(crossed, 1.0))


def test_postures_in_which_links_touch_are_out_of_reach(a1, home):
    stance = nominal_stance(a1)
    crossed = with_joints(a1, FL_hip_joint=-0.36, FR_hip_joint=0.36)
    feet = foot_positions(a1, crossed)
    for refuse in (
        lambda: check_posture(a1, stance, feet, near=crossed),
        lambda: held_posture(a1, "crossed", feet, crossed),
    ):
        with pytest.raises(ReachError, match=r"^link 'FL_foot' would touch link 'FR_foot'$"):
            refuse()


@pytest.mark.parametrize("seed", range(3))
def test_floor_contact_agrees_with_the_shapes(a1, skewed, seed):
    """The reference is the lowest point of each shape, on floors with random slopes."""
    random = np.random.default_rng(seed)
    for robot in (a1, skewed):
        position = random.uniform(robot.lower_limit, robot.upper_limit)
        up = random.normal(size=3) / 4 + [0, 0, 1]
        up /= np.linalg.norm(up)
        poses = Kinematics(robot).joint_poses(position)
        shanks = {leg.joint_ids[-1] for leg in robot.legs.values()}
        shapes = [shape for shape in pairs_of(robot).shapes.geometryObjects if shape.parentJoint not in shanks]
        truth = [lowest(shape.geometry, poses[shape.parentJoint] * shape.placement, up) for shape in shapes]
        contact = floor_contact(robot, poses, up, min(truth))
        assert contact.links == (link_of(shapes[int(np.argmin(truth))]), FLOOR)
        assert contact.distance == pytest.approx(0.0, abs=1e-6)
        assert floor_contact(robot, poses, up, min(truth) - 1.01 * pairs_of(robot).least) is None


def lowest(geometry, pose, up):
    x, y, z = np.abs(pose.rotation.T @ up)
    down = {
        coal.Box: lambda box: (x, y, z) @ box.halfSide,
        coal.Sphere: lambda sphere: sphere.radius,
        coal.Capsule: lambda capsule: z * capsule.halfLength + capsule.radius,
        coal.Cylinder: lambda cylinder: z * cylinder.halfLength + np.hypot(x, y) * cylinder.radius,
    }[type(geometry)]
    return up @ pose.translation - down(geometry)


BELLY = """<link name="belly"><collision><geometry><box size="0.2 0.1 0.4"/></geometry></collision></link>
<joint name="under" type="fixed"><parent link="trunk"/><child link="belly"/></joint>"""


def test_a_crouch_that_puts_the_belly_on_the_floor_is_out_of_reach(tmp_path):
    robot = load_text(tmp_path, quadruped_urdf(extra=BELLY))
    stance = nominal_stance(robot)
    com = Kinematics(robot).com(stance.joint_position)
    room = stance.base_height - 0.2  # below a box that is 0.4 m high
    for crouch, refused in ((room - 6e-3, False), (room - 3e-3, True)):
        feet = feet_in_posture(stance, com, BodyPosture(crouch=crouch / stance.hip_height))
        if refused:
            with pytest.raises(ReachError, match=r"^link 'belly' would come within 3.0 mm of the floor$"):
                check_posture(robot, stance, feet)
        else:
            check_posture(robot, stance, feet)
