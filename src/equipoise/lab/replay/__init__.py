"""Replay of recorded motions in a physics engine."""
