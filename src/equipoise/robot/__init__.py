"""What we know of a robot: its model, kinematics, stance and nominal inertia."""
