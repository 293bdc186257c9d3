"""Interface between experiments and robots: the platform protocol, and wrappers of platforms."""
