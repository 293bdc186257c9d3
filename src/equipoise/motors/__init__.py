"""Method that estimates friction, rotor inertia, torque gain and delay of each joint."""
