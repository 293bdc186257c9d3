"""The paper's routine: two bisections for the planar CoM, three excitations for moments of inertia.

    python examples/03_paper_method.py

docs/get-started.md shows what this prints.
"""

from equipoise import ComSearchSettings, PaperMethod, calibrate, load_robot, simulate

robot = load_robot("unitree_a1")
settings = PaperMethod(com_search=ComSearchSettings(tolerance=0.002))
with simulate(robot, preset="ideal", payload="1,0.05,0.02,0.08") as simulation:
    result = calibrate(simulation.platform, robot, settings).with_truth(simulation.truth)

for trial in result.trials:
    if trial.kind == "lift":
        print(f"on {trial.about}, offset {1000 * trial.offset:+6.1f} mm: {trial.verdict}")
for diagonal, line in result.support_lines.items():
    print(f"{diagonal}: balances at {1000 * line.offset:+.1f} mm")

com = result.composite.com_in_base
print(f"CoM off by {1000 * com.x.error:+.2f}, {1000 * com.y.error:+.2f} mm")
for axis, excitation in result.excitations.items():
    print(
        f"about {axis}: I {excitation.moment:.3f} kg m2, C {excitation.damping:.2f} Nm s/rad at {excitation.frequency:.2f} Hz"
    )
