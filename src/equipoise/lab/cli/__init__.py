"""Verbs of the lab: `equipoise lab VERB`."""

VERBS = {
    "balance": ("equipoise.lab.cli.balance", "stand on two feet in simulation, to test a centre of mass"),
    "emulate": ("equipoise.lab.cli.emulate", "a simulated robot that speaks a real robot's protocol"),
    "monte-carlo": ("equipoise.lab.cli.monte_carlo", "calibrate many simulated robots, and count how near they come"),
    "reproduce": ("equipoise.lab.cli.reproduce", "the paper's table, figures and rates, made again"),
    "validate": ("equipoise.lab.cli.validate", "play a run's lifts again in simulation: which body tips so"),
}
"""Verbs: the module of each and its purpose, as in `equipoise.cli`."""
