"""Standing on two diagonal feet by feedback: what a right centre of mass is good for."""
