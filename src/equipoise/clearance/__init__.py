"""Distances between a robot's links, from simple shapes on them."""
