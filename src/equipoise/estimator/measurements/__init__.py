"""What lifts, moves and torques say: the measurement equations of the precise method."""
