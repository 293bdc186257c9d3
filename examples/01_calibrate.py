"""Calibrate a simulated A1 that carries a kilogram its model file knows nothing of.

    python examples/01_calibrate.py [ROBOT_TIME_IN_SECONDS]

docs/examples.md shows what this prints.
"""

import sys

from equipoise import CalibrationSettings, calibrate, load_robot, simulate
from equipoise.precise.parameters import components
from equipoise.precise.routine import PreciseSettings

budget = float(sys.argv[1]) if len(sys.argv) > 1 else None

robot = load_robot("unitree_a1")
with simulate(robot, noise="realistic", payload="1,0.05,0.02,0.08", seed=3) as simulation:
    settings = CalibrationSettings(precise=PreciseSettings(budget=budget))
    result = calibrate(simulation.platform, robot, settings).with_truth(simulation.truth)

truth = components(simulation.truth.composite)
estimate = result.composite.by_name()
for (name, interval), true in zip(result.uncertainty["composite"].intervals.items(), truth, strict=True):
    between = f"{interval.lower:8.4f} to {interval.upper:8.4f}"
    print(f"{name:5} {estimate[name]:8.4f}, 95 % {between}; truth {true:8.4f}; {interval.verdict}")
print("all checks passed" if result.trustworthy else "\n".join(result.warnings))
