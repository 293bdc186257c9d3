"""An engine to walk in that the package does not have."""
