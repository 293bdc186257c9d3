"""Simulated robots: engines, errors of sensors and actuators, payloads, and the truth."""
