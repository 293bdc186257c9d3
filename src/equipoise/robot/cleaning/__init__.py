"""Cleaning of model files: what both engines can read, and nothing that belongs to a simulation alone."""
