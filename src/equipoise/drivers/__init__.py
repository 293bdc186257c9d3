"""Real robots: one deadline loop, and a link for each robot or bus."""
