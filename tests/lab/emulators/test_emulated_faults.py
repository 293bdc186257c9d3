"""Faults of the emulators: body, sensors and wire over both protocols, wiring errors without a wire."""

import importlib
import io
import time
from contextlib import closing, contextmanager

import numpy as np
import pytest
from emulator_processes import free_port, running_emulator, unused_domain

from equipoise import nominal_stance
from equipoise.drivers.unitree.dds_settings import UnitreeDdsSettings
from equipoise.drivers.unitree.udp import open_connection as open_udp
from equipoise.drivers.unitree.udp_settings import UnitreeUdpSettings
from equipoise.lab.emulators.emulated_robot import EmulatedRobot, EmulatorSettings
from equipoise.lab.emulators.faults import CrossedWiring
from equipoise.platform.platform import JointCommand

pytestmark = pytest.mark.realtime
PATIENCE = 10.0  # [s]


@contextmanager
def over_dds():
    pytest.importorskip("cyclonedds")
    open_dds = importlib.import_module("equipoise.drivers.unitree.dds").open_connection
    domain = unused_domain()
    flags = "--domain", domain, "--sim-preset", "ideal", "--start", "standing", "--no-sport-mode", "--trace"
    with running_emulator("unitree-dds", *flags) as emulator:
        settings = UnitreeDdsSettings(interface="lo", domain=domain, silence=5.0, release_sport_mode=False)
        yield emulator, lambda robot: open_dds(robot, settings)


@contextmanager
def over_udp():
    port = free_port()
    flags = "--protocol", "go1", "--port", port, "--sim-preset", "ideal", "--start", "standing", "--trace"
    with running_emulator("unitree-udp", *flags) as emulator:
        settings = UnitreeUdpSettings(
            protocol="go1", address="127.0.0.1", port=port, local_port=free_port(), silence=5.0
        )
        yield emulator, lambda robot: open_udp(robot, settings)


class Standing:
    """Standing emulator with a commanded stance."""

    def __init__(self, emulator, link, robot):
        self.emulator, self.link = emulator, link
        self._command = JointCommand(nominal_stance(robot).joint_position)

    def states(self, duration=0.1):
        """Return the samples of a duration in which the stance is commanded."""
        states, until = [], time.monotonic() + duration
        while time.monotonic() < until:
            self.link.send(self._command)
            states += self.link.receive()
            time.sleep(2e-3)
        return states

    def traced(self, begun, duration):
        """Return the motion of the base since an entry of the log, for a duration by the clock of the emulator."""
        until, first = time.monotonic() + PATIENCE, self.emulator.log.index(begun)
        while time.monotonic() < until:
            self.states(0.05)
            since = self.emulator.log[first:]
            if since[-1]["time"] - begun["time"] >= duration:
                return [entry for entry in since if "tilt" in entry]
        raise AssertionError(f"too little was traced: {self.emulator.log[-5:]}")

    def until(self, condition):
        """Return the first sample that meets a condition."""
        until = time.monotonic() + PATIENCE
        while time.monotonic() < until:
            for state in self.states(0.02):
                if condition(state):
                    return state
        raise AssertionError(f"condition not met: {self.emulator.log[-5:]}")


@pytest.fixture(scope="module", params=[over_dds, over_udp], ids=["dds", "udp"])
def standing(request, a1):
    with request.param() as (emulator, opened), closing(opened(a1)) as link:
        until = time.monotonic() + PATIENCE
        while not link.receive():
            assert time.monotonic() < until
        yield Standing(emulator, link, a1)
        link.release()


@pytest.mark.parametrize(
    ("keys", "request_"), [("L2+B", "damp"), ("A", "lie down"), ("L2", "lie down"), ("left+R1", "lie down")]
)
def test_keys_of_the_remote_control_are_requests(standing, keys, request_):
    standing.until(lambda state: state.request == "")
    standing.emulator.fault(press=keys, **{"for": 0.1})
    assert standing.until(lambda state: state.request).request == request_
    standing.until(lambda state: state.request == "")


def test_temperature_and_charge_are_reported_as_set(standing):
    standing.emulator.fault(temperature=81, charge=0.05)
    hot = standing.until(lambda state: state.health.motor_temperature[0] == 81)
    assert hot.health.battery_charge == pytest.approx(0.05)
    standing.emulator.fault(temperature=40, charge=0.8)
    standing.until(lambda state: state.health.motor_temperature[0] == 40)


@pytest.mark.parametrize("what", ["imu", "encoders"])
def test_sensors_freeze_and_are_lost(standing, what):
    standing.emulator.fault(freeze=what, push=[0, 15, 0], **{"for": 0.4})
    standing.emulator.wait_for("fault", "freeze")
    standing.states(0.05)
    frozen = standing.states(0.1)
    fields = {"imu": "angular_velocity_in_imu", "encoders": "joint_position"}
    assert np.ptp([getattr(state, fields[what]) for state in frozen], axis=0).max() == 0
    assert np.ptp([getattr(state, fields[{"imu": "encoders", "encoders": "imu"}[what]]) for state in frozen]) > 0
    standing.states(0.6)
    standing.emulator.fault(lose=what, **{"for": 0.1})
    standing.until(lambda state: not getattr(state, fields[what]).any())
    standing.until(lambda state: getattr(state, fields[what]).any())


def test_one_encoder_is_lost(standing, a1):
    standing.emulator.fault(lose="RL_calf_joint", **{"for": 0.1})
    state = standing.until(lambda state: not state.joint_position.all())
    assert a1.joint_names[int(np.flatnonzero(state.joint_position == 0)[-1])] == "RL_calf_joint"


def test_samples_are_replayed(standing):
    standing.emulator.fault(replay=0.1, **{"for": 1.5})
    assert standing.until(lambda state: True)
    times = np.array([state.time for state in standing.states(2.0)])
    late = np.diff(times)[np.diff(times) < -0.3]
    assert len(late) > 10
    assert np.allclose(late, -0.5, atol=0.1)


def test_a_push_tilts_the_robot_and_is_traced(standing):
    standing.states(0.3)
    before = standing.emulator.log[-1]
    standing.emulator.fault(push=[0, 15, 0], **{"for": 0.3})
    traced = standing.traced(standing.emulator.wait_for("fault", "push", after=before), duration=0.8)
    assert max(entry["tilt"] for entry in traced) > 0.4
    assert traced[-1]["tilt"] < 0.3
    assert np.ptp([entry["height"] for entry in traced]) < 0.1
    assert np.diff([entry["time"] for entry in traced]).min() < 0.11


def test_a_blocked_joint_stays_and_reports_its_commanded_torque(standing, a1):
    joint = a1.joint_names.index("FL_calf_joint")
    standing.emulator.fault(block="FL_calf_joint")
    standing.states(0.1)
    command, moved = standing._command, standing._command.position.copy()
    moved[joint] += 0.1
    standing._command = JointCommand(moved)
    states = standing.states(0.4)
    assert abs(states[-1].joint_position[joint] - states[0].joint_position[joint]) < 0.02
    kp = a1.gains(nominal_stance(a1).hip_height)[0]
    strain = kp * (moved[joint] - states[-1].joint_position[joint])
    assert states[-1].joint_torque[joint] == pytest.approx(strain, rel=0.1)
    standing.emulator.fault(block="")
    standing._command = command
    standing.states(0.4)


def test_a_fault_waits_for_its_time_or_for_a_lift(standing):
    standing.emulator.fault(press="X", after=1e9)
    standing.emulator.fault(press="Y", when="lift")
    assert not any(state.request for state in standing.states(0.3))


def test_many_damaged_samples_do_not_delay_a_control_loop(standing):
    """With 20,000 damaged samples per second, calls of `receive` are short and valid samples are found."""
    standing.states(0.1)
    rejected = standing.link.rejected
    standing.emulator.fault(garbage=20_000)
    time.sleep(0.2)
    took, good = [], 0
    for _ in range(500):
        standing.link.send(standing._command)
        begun = time.thread_time()
        good += len(standing.link.receive())
        took.append(time.thread_time() - begun)
        time.sleep(1e-3)
    standing.emulator.fault(garbage=0)
    standing.states(0.3)
    assert standing.link.rejected - rejected > 2_000
    assert good > 100
    assert np.quantile(took, 0.9) < 2e-3


def test_a_disconnected_cable_stops_samples_and_commands(standing):
    standing.states(0.1)
    before = len(standing.emulator.log)
    standing.emulator.fault(cut=True, **{"for": 0.5})
    standing.emulator.wait_for("mode", "silence")  # commands do not arrive either
    standing.states(0.05)
    assert not standing.states(0.1)
    assert standing.until(lambda state: True)
    assert min(entry["speed"] for entry in standing.emulator.log[before:] if "speed" in entry) < -0.05  # it sank


def test_an_invalid_fault_line_ends_the_emulator(a1):
    with over_udp() as (emulator, _):
        emulator.fault(pres="A")
        emulator._process.wait(timeout=PATIENCE)
    assert emulator._process.returncode == 1


@pytest.mark.parametrize(
    ("wiring", "exchanged"),
    [
        ("left-right", {"FL": "FR", "FR": "FL", "RL": "RR", "RR": "RL"}),
        ("front-rear", {"FL": "RL", "RL": "FL", "FR": "RR", "RR": "FR"}),
        ("legs-reversed", {"FL": "RR", "RR": "FL", "FR": "RL", "RL": "FR"}),
    ],
)
def test_legs_are_exchanged_in_samples_and_commands(a1, wiring, exchanged):
    robot = EmulatedRobot(a1, EmulatorSettings(sim_preset="ideal", wiring=wiring), io.StringIO())
    target, calf = nominal_stance(a1).joint_position.copy(), a1.legs["FL"].joints[2]
    before = robot.step().joint_position[calf]
    target[calf] += 0.1
    for _ in range(200):
        robot.receive(JointCommand(target))
        state = robot.step()
    assert state.joint_position[calf] - before > 0.06  # the sample and the command are exchanged alike
    there = list(a1.legs[exchanged["FL"]].joints)
    assert np.array_equal(state.joint_position[list(a1.legs["FL"].joints)], robot._state.joint_position[there])


def test_hip_signs_and_a_rotated_imu(a1):
    robot = EmulatedRobot(a1, EmulatorSettings(sim_preset="ideal"), io.StringIO())
    state, hips = robot.step(), [leg.joints[0] for leg in a1.legs.values()]
    signs = CrossedWiring(a1, "hip-signs", "both").sensed(state)
    assert np.array_equal(signs.joint_position[hips], -state.joint_position[hips])
    assert np.array_equal(signs.joint_torque[hips], -state.joint_torque[hips])
    command = JointCommand(state.joint_position, kp=np.ones(12), kd=np.ones(12))
    assert np.array_equal(CrossedWiring(a1, "hip-signs", "both").commanded(command).position, signs.joint_position)
    assert CrossedWiring(a1, "hip-signs", "samples").commanded(command) is command
    assert CrossedWiring(a1, "hip-signs", "commands").sensed(state) is state
    x, y, z = state.acceleration_in_imu
    turned = CrossedWiring(a1, "imu-quarter-turn", "both").sensed(state)
    assert np.array_equal(turned.acceleration_in_imu, [-y, x, z])
    assert np.array_equal(turned.joint_position, state.joint_position)
