"""Methods of others, on the same simulated robots and recordings as ours."""
