"""Runs with a prior run of the same robot: prior, changes since, estimate of both runs."""
