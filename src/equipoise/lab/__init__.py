"""Experiments on equipoise itself: studies, the paper's results made again, DART, emulators. The core does not import it."""
