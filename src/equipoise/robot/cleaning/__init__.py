"""Cleaning of model files for both engines, without elements that belong to a simulation alone."""
