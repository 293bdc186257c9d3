"""Calibration from settings to run folder, and comparison of several calibrations."""
