"""A run of a robot that was calibrated before: what is kept of it, what changed since, and what is on the robot now."""
