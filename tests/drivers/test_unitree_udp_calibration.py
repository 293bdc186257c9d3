"""A calibration over UDP, guarded, through a network that loses, repeats and mixes up packets."""

import numpy as np
import pytest
from emulator_processes import free_port, running_emulator

from equipoise import calibrate, simulate
from equipoise.drivers.hardware import HardwarePlatform
from equipoise.drivers.unitree.packets import DAMAGES
from equipoise.drivers.unitree.udp import open_connection
from equipoise.drivers.unitree.udp_settings import UnitreeUdpSettings
from equipoise.guard.guard import Guard
from equipoise.guard.limits import Limits
from equipoise.lab.static.method import Static

STATIC = Static()
PAYLOAD, SEED = "1,0.05,0.02,0.08", 3
FAULTS = ("--loss", 0.02, "--duplicate", 0.02, "--reorder", 0.02)
BUSY = Limits(silence=1.0, stall=1.0)  # for a machine that has other things to do, too


@pytest.mark.realtime
def test_a_calibration_over_a_bad_network_has_the_same_result_as_one_without_network(a1):
    """A robot without joint friction: what friction leaves in the torques depends on how the robot came to stand."""
    with simulate(a1, "ideal", PAYLOAD, SEED) as simulation:
        direct = calibrate(simulation.platform, a1, STATIC).with_truth(simulation.truth)
    recordings, port = [], free_port()
    robot = ("--protocol", "go1", "--port", port, "--payload", PAYLOAD, "--seed", SEED, "--sim-preset", "ideal")
    with running_emulator("unitree-udp", *robot, *FAULTS) as emulator:
        link = open_connection(a1, UnitreeUdpSettings("go1", "127.0.0.1", port, local_port=free_port(), silence=1.0))
        platform = HardwarePlatform(link)
        with Guard(platform, a1, BUSY) as guard:
            result = calibrate(guard, a1, STATIC, keep=recordings.append)
    composite = result.composite
    assert abs(composite.mass.value - direct.composite.mass.value) < 0.05
    assert np.abs((composite.values - direct.composite.values)[1:3]).max() < 1e-3
    composite = result.with_truth(simulation.truth).composite
    assert abs(composite.mass.error) < 0.05
    assert np.abs(composite.com_in_base.errors[:2]).max() < 1e-3
    arrived, counts = link.counts, guard.report().samples
    assert sum(arrived[kind] for kind in DAMAGES) == 0
    assert min(counts.missing, counts.repeated, counts.out_of_order) > 10
    times = recordings[-1].joints.time
    taken = (times[-1] - times[0]) / 2e-3
    assert 0.9 * taken < len(times) < 0.99 * taken
    assert emulator.end()[-1]["damaged"] == 0
