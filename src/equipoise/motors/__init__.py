"""What moves the legs: friction, rotor inertia, torque gain and delay of each joint."""
