"""Verbs of the lab: `equipoise lab VERB`."""

VERBS = {
    "balance": ("equipoise.lab.cli.balance", "balance a simulated robot on two feet with the result"),
    "emulate": ("equipoise.lab.cli.emulate", "start an emulator that uses the protocol of a real robot"),
    "monte-carlo": ("equipoise.lab.cli.monte_carlo", "calibrate many simulated robots and compute error statistics"),
    "reproduce": ("equipoise.lab.cli.reproduce", "reproduce the paper's table, figures and rates"),
    "validate": ("equipoise.lab.cli.validate", "replay a run's lifts in simulation with the result and the model"),
}
"""Module and purpose of each verb, as in `equipoise.cli`."""
