"""Bayesian method: mass, 3-D CoM and inertia, with the sensors calibrated in the same estimate."""
