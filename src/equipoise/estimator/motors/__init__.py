"""What swings of the legs determine of friction, armature, gain and delay of each joint, and of the links."""
