"""Calibration methods: base class and table of methods."""
