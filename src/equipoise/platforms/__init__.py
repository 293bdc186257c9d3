"""What can move: the platform seam, the simulated robot, and what is wrong with its sensors."""
