"""Runs and logs in the Rerun viewer, live or afterwards."""
