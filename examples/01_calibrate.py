"""Calibrate a simulated A1 that carries a kilogram its model file knows nothing of.

    python examples/01_calibrate.py [ROBOT_TIME_IN_SECONDS]

docs/get-started.md shows what this prints.
"""

import sys

from equipoise import BayesianMethod, calibrate, load_robot, simulate

budget = float(sys.argv[1]) if len(sys.argv) > 1 else None

robot = load_robot("unitree_a1")
with simulate(robot, preset="realistic", payload="1,0.05,0.02,0.08", seed=3) as simulation:
    settings = BayesianMethod(duration=budget)
    result = calibrate(simulation.platform, robot, settings).with_truth(simulation.truth)

for one in result.composite:
    between = f"{one.lower:8.4f} to {one.upper:8.4f}"
    print(f"{one.name:5} {one.value:8.4f}, 95 % {between}; truth {one.truth:8.4f}; {one.verdict}")
print("all checks passed" if result.trustworthy else "\n".join(result.warnings))
