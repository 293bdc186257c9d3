"""Our estimators and the alternatives that users have, on the same simulated robots and recordings."""
