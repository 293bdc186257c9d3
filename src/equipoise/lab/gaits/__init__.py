"""How simulated robots walk: for logs to try things on."""
