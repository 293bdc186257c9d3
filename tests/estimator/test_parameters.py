"""Parameter vector, bodies and priors."""

import dataclasses

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from equipoise import nominal_stance
from equipoise.errors import SettingsError
from equipoise.estimator.parameters import Unknowns, base_vector, log_cholesky
from equipoise.estimator.unknowns import Priors, model_values
from equipoise.robot.inertial import (
    COMPONENTS,
    InertialParameters,
    base_parameters,
    components,
    composite_parameters,
    stance_effective_parameters,
)

ROBOTS = ("a1", "skewed", "two_jointed")
BODIES = {
    "robot_body": composite_parameters,
    "base_body": lambda robot, position: base_parameters(robot),
    "stance_effective_body": stance_effective_parameters,
}


@pytest.fixture(scope="module", params=ROBOTS)
def unknowns(request):
    robot = request.getfixturevalue(request.param)
    return Unknowns(robot, nominal_stance(robot), Priors())


def somewhere(unknowns, seed=0):
    """Return a vector near the model's with every parameter changed."""
    return unknowns.start() + 0.3 * np.random.default_rng(seed).standard_normal(unknowns.size)


def random_body(seed):
    """Return the body of a few point masses at random positions."""
    generator = np.random.default_rng(seed)
    masses, points = generator.uniform(0.1, 2, 7), 0.2 * generator.standard_normal((7, 3)) + [0.1, -0.2, 0.05]
    com = masses @ points / masses.sum()
    arms = points - com
    inertia = sum(m * (a @ a * np.eye(3) - np.outer(a, a)) for m, a in zip(masses, arms, strict=True))
    return InertialParameters(masses.sum(), com, inertia)


@pytest.mark.parametrize("seed", range(5))
def test_log_cholesky_parameters_are_pinocchios_there_and_back(seed):
    body = random_body(seed)
    parameters = log_cholesky(body)
    np.testing.assert_allclose(
        base_vector(parameters), body.to_pinocchio().toDynamicParameters(), rtol=1e-9, atol=1e-12
    )
    again = InertialParameters.from_pinocchio(pin.Inertia.FromDynamicParameters(base_vector(parameters)))
    np.testing.assert_allclose(log_cholesky(again), parameters, atol=1e-9)


@given(hnp.arrays(float, 10, elements=st.floats(-2, 2)))
def test_every_vector_is_a_physically_consistent_body(parameters):
    body = InertialParameters.from_pinocchio(pin.Inertia.FromDynamicParameters(base_vector(parameters)))
    assert body.physical_defect() is None


def test_components_are_in_the_order_of_their_names():
    body = InertialParameters(7.0, [1.0, 2.0, 3.0], [[4.0, 7.0, 8.0], [7.0, 5.0, 9.0], [8.0, 9.0, 6.0]])
    values = {"mass": 7, "com_x": 1, "com_y": 2, "com_z": 3, "Ixx": 4, "Iyy": 5, "Izz": 6, "Ixy": 7, "Ixz": 8, "Iyz": 9}
    assert dict(zip(COMPONENTS, components(body), strict=True)) == values


@pytest.mark.parametrize("body", BODIES)
def test_at_the_start_bodies_are_the_models(unknowns, body):
    robot, position = unknowns.robot, unknowns.stance.joint_position
    expected = components(BODIES[body](robot, position))
    np.testing.assert_allclose(components(getattr(unknowns, body)(unknowns.start())), expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("body", BODIES)
def test_away_from_the_start_bodies_are_those_of_a_robot_with_other_links(unknowns, body):
    robot, x = unknowns.robot, somewhere(unknowns)
    model = robot.pinocchio.copy()
    model.inertias[1] = pin.Inertia.FromDynamicParameters(unknowns.inertial(x)[:10])
    joints = [joint for leg in robot.legs.values() for joint in leg.joint_ids]
    factors, moments = np.split(unknowns.inertial(x)[10:], [len(joints)])
    for joint, factor, moment in zip(joints, factors, moments.reshape(-1, 3), strict=True):
        link = robot.pinocchio.inertias[joint]
        ahead, behind = (pin.Inertia(1.0, link.lever + sign * moment / 2, np.zeros((3, 3))) for sign in (1, -1))
        vector = factor * link.toDynamicParameters() + ahead.toDynamicParameters() - behind.toDynamicParameters()
        model.inertias[joint] = pin.Inertia.FromDynamicParameters(vector)
    other = dataclasses.replace(robot, pinocchio=model)
    expected = components(BODIES[body](other, unknowns.stance.joint_position))
    np.testing.assert_allclose(components(getattr(unknowns, body)(x)), expected, rtol=1e-9, atol=1e-12)
    assert np.abs(expected[0] - components(BODIES[body](robot, unknowns.stance.joint_position))[0]) > 0.1


def test_the_jacobian_of_the_inertial_parameters_is_that_of_differences(unknowns):
    x = somewhere(unknowns)
    jacobian = unknowns.inertial_jacobian(x)
    assert jacobian.shape == (10 + 4 * len(unknowns.robot.joint_names), unknowns.size)
    for column, unit in enumerate(1e-6 * np.eye(unknowns.size)):
        difference = (unknowns.inertial(x + unit) - unknowns.inertial(x - unit)) / 2e-6
        np.testing.assert_allclose(jacobian[:, column], difference, rtol=1e-6, atol=1e-8)


def test_every_parameter_has_one_index(unknowns):
    sizes = {"base": 10} | {row.name: len(row.each.labels(unknowns.robot)) for row in unknowns.rows}
    places = np.concatenate([np.arange(unknowns.size)[unknowns[name]] for name in sizes])
    assert sorted(places) == list(range(unknowns.size))
    assert all(unknowns[name].stop - unknowns[name].start == size for name, size in sizes.items())
    np.testing.assert_array_equal(unknowns.columns(*sizes), places)
    tilt = unknowns["imu_tilt"]
    assert list(unknowns.columns("imu_tilt", "base")) == [*range(tilt.start, tilt.stop), *range(10)]


def test_one_unit_is_one_standard_deviation_of_the_prior(a1):
    priors = Priors(joint_offset=0.01, imu_tilt=0.02, accelerometer_bias=0.3, clock_offset=0.004, foot_radius=0.05,
                    floor_slope=0.006, floor_warp=0.007, torque_gain=0.08, coulomb_friction=0.9, leg_mass=0.1,
                    leg_mass_common=0.2)  # fmt: skip
    stance = nominal_stance(a1)
    unknowns = Unknowns(a1, stance, priors)
    ones = np.ones(unknowns.size)
    values = unknowns.values(ones)
    np.testing.assert_allclose(values["joint_offset"], 0.01)
    np.testing.assert_allclose(values["imu_tilt"], 0.02)
    np.testing.assert_allclose(values["accelerometer_bias"], 0.3)
    np.testing.assert_allclose(values["floor_slope"], 0.006)
    assert (values["clock_offset"], values["foot_radius"]) == pytest.approx((0.004, 0.05))
    assert unknowns.value(ones, "floor_warp") == pytest.approx([0.007 * stance.hip_height])
    assert unknowns.value(ones, "torque_gain") == pytest.approx([0.08] * 12)
    assert unknowns.value(ones, "coulomb_friction") == pytest.approx([0.9 * a1.mass * 9.81 * stance.hip_height / 38.0])
    np.testing.assert_allclose(unknowns.inertial(ones)[10:22], 1 + 0.1 + 0.2)


def test_nothing_is_wrong_at_the_start(unknowns):
    values = unknowns.values(unknowns.start())
    assert list(values) == [row.name for row in Priors.rows()]
    assert not any(value.any() for value in values.values())
    assert {name: len(value) for name, value in values.items()} == {
        name: len(value) for name, value in model_values(unknowns.robot).items()
    }


ROWS = [row.name for row in Priors.rows()]
OF_THE_BASE = [field.name for field in dataclasses.fields(Priors) if field.name not in ROWS]


def test_no_row_is_fixed_by_default():
    """Effects that a robot may have are estimated unless the user fixes them."""
    assert [row.name for row in Priors().estimated] == ROWS
    assert Priors().holding("backlash", "external_force").all_open == Priors()
    assert OF_THE_BASE == ["mass", "first_moment", "inertia"]


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
@pytest.mark.parametrize("name", OF_THE_BASE)
def test_a_prior_of_the_base_must_be_positive(name, value):
    with pytest.raises(SettingsError, match=f"the prior of {name} is {value}; it must be a finite number above zero"):
        Priors(**{name: value})


@pytest.mark.parametrize("value", [-1.0, float("nan"), float("inf")])
@pytest.mark.parametrize("name", ROWS)
def test_a_prior_of_a_row_must_not_be_negative(name, value):
    with pytest.raises(
        SettingsError, match=f"{name} is {value}; it must be a finite number above zero, or zero to fix"
    ):
        Priors(**{name: value})


@pytest.mark.parametrize("name", ROWS)
def test_a_fixed_row_is_not_in_the_vector_and_has_the_models_value(a1, name):
    """All other values stay the same."""
    stance = nominal_stance(a1)
    held, opened = (Unknowns(a1, stance, priors) for priors in (Priors().all_open.holding(name), Priors().all_open))
    count = len(model_values(a1)[name])
    assert opened.size == held.size + count
    assert (opened.value(np.ones(opened.size), name) > 0).all()
    ones = np.ones(held.size)
    assert opened.estimates(name)
    assert not held.estimates(name)
    assert not held.columns(name).size
    values, as_before = held.values(ones), opened.values(np.ones(opened.size))
    np.testing.assert_array_equal(values.pop(name), np.zeros(count))
    for other, value in values.items():
        np.testing.assert_array_equal(value, as_before[other])


def test_several_rows_are_fixed_and_the_rest_stay():
    priors = Priors(joint_offset=0.01, backlash=0.3)
    held = priors.holding("compliance", "backlash")
    assert held == Priors(joint_offset=0.01, backlash=0.0, compliance=0.0)
    assert held == dataclasses.replace(priors, compliance=0.0, backlash=0.0)
    with pytest.raises(SettingsError, match=r"the prior of mass is 0\.0"):
        priors.holding("mass")


# --- files of priors


@pytest.fixture
def read(tmp_path):
    """Return a function that reads priors from a file with a text."""

    def of(text):
        file = tmp_path / "priors.toml"
        file.write_text(text, encoding="utf-8")
        return Priors.read(file)

    return of


def test_priors_are_read_and_the_rest_have_defaults(read):
    assert read("") == Priors()
    found = read("# a bench\ncompliance = 0\nmass = 0.1  # ours\nexternal_force = 2.5e-1\n")
    assert found == Priors(compliance=0.0, mass=0.1, external_force=0.25)
    assert isinstance(found.compliance, float)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("complience = 0.001", r"priors.toml: 'complience' is not a parameter; did you mean 'compliance'\?"),
        (
            "xyzzy = 0.001",
            r"'xyzzy' is not a parameter; choose from mass, first_moment, inertia, leg_mass, .*, armature$",
        ),
        ("backlash = 'much'", "priors.toml: the prior of backlash is 'much'; it must be a number"),
        ("backlash = true", "the prior of backlash is True; it must be a number"),
        ("[backlash]\nhip = 0.1", "the prior of backlash is .*; it must be a number"),
        ("mass = 0", "the prior of mass is 0.0; it must be a finite number above zero"),
        (
            "backlash = inf",
            "the prior of backlash is inf; it must be a finite number above zero, or zero to fix the parameter",
        ),
        ("backlash: 0.1", "cannot read priors from .*priors.toml: "),
    ],
)
def test_an_invalid_file_of_priors_is_refused(read, text, message):
    with pytest.raises(SettingsError, match=message):
        read(text)


def test_a_missing_or_binary_file_of_priors_is_refused(tmp_path):
    with pytest.raises(SettingsError, match=r"cannot read priors from .*none.toml: .*No such file"):
        Priors.read(tmp_path / "none.toml")
    (tmp_path / "bytes.toml").write_bytes(b"backlash = \xff")
    with pytest.raises(SettingsError, match=r"cannot read priors from .*bytes.toml: "):
        Priors.read(tmp_path / "bytes.toml")
