"""What was added to a robot between two runs: both are estimated together, so that the sensors' errors cancel.

python examples/05_payload.py [RUN_BEFORE RUN_AFTER]
"""

import sys

from equipoise import RunFolder, ScaleReadings, calibrate, find_payload_change, load_robot, simulate

if len(sys.argv) > 2:
    before, after = (RunFolder.open(path).recordings() for path in sys.argv[1:])
    robot, scale = RunFolder.open(sys.argv[1]).robot(), None
else:
    robot, before, after = load_robot("unitree_a1"), [], []
    for recordings, payload in ((before, None), (after, "1,0.05,0.02,0.08")):
        with simulate(robot, preset="realistic", payload=payload, seed=3) as simulation:  # the same sensors in both
            calibrate(simulation.platform, robot, keep=recordings.append)
    scale = ScaleReadings(masses=(12.44, 13.44))  # one scale, twice

delta = find_payload_change(robot, before, after, scale)
mass = delta.payload.mass
print(f"{'removed' if delta.removed else 'added'}: {mass.value:.2f} kg ({mass.lower:.2f} to {mass.upper:.2f})")
for one in delta.payload.com_in_base:
    if one.value is not None:  # of no mass nothing is said of where it is
        print(f"{one.name}: {1000 * one.lower:.0f} to {1000 * one.upper:.0f} mm")
