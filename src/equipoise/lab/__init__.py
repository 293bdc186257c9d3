"""Experiments with equipoise: studies, reproduction of the paper, DART, emulators. The core does not import this package."""
