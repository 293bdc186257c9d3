"""Samples and commands of a motion: records, their files, and the log of a run."""
