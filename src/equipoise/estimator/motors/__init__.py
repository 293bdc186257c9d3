"""Estimation of friction, armature, gain and delay of each joint, and of leg links, from leg swings."""
