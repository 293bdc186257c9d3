"""Gaits of simulated robots, to make logs of walking robots."""
