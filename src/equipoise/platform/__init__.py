"""The seam between experiments and robots: what a platform is, and platforms around platforms."""
