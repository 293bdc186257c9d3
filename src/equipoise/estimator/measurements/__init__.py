"""What lifts, moves and torques say: the measurement equations of the Bayesian method."""
