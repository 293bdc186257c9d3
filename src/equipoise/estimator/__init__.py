"""Maximum a posteriori estimate: table of parameters, equations, solution, checks."""
