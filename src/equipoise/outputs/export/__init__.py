"""Results in the files that controllers and simulators read."""
