"""Feedback control of a robot that stands on two diagonal feet, as a test of its CoM."""
