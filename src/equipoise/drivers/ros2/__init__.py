"""Robots and simulators that speak ROS 2."""
