"""Monte Carlo studies, and the reproduction of the paper's results."""
