"""The routines by name: what each does with a robot, and what it makes of the recordings."""
