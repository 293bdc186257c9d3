"""Model of a robot: kinematics, stance and nominal inertia."""
