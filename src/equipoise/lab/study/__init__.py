"""Monte Carlo studies, and the paper's results made again."""
