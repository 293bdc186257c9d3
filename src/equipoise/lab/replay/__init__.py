"""Recorded motions played again in an engine."""
