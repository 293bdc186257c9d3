"""Display of runs and logs in the Rerun viewer, live or recorded."""
