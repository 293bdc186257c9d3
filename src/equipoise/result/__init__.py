"""Results of a calibration: estimates with intervals, checks, and their JSON form."""
