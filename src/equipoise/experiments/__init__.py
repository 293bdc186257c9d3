"""Motions and parts of trials that all methods use: standing up, planted feet, lifts, excitations, and when a lift ends."""
