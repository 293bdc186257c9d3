"""Clearance between a robot's links: simple bodies on them, and the distances between these."""
