"""Simulated robots in engines that the package has, and in one that it does not have."""
