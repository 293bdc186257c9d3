"""The result in the files that controllers and simulators read."""
