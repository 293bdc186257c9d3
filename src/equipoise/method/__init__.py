"""What a method of calibration is, and which there are."""
