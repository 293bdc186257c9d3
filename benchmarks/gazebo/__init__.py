"""Gazebo 11, in a Debian root of its own, as a physics engine of benchmarks."""
