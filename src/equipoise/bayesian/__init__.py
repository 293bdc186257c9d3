"""The Bayesian method: 3-D CoM, mass and the whole inertia, with the sensors calibrated on the way."""
