"""Simulated robots that speak a real robot's protocol, each in a process of its own: to try a driver without the robot."""
