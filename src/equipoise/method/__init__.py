"""Methods of calibration: their base class, and the table of all."""
