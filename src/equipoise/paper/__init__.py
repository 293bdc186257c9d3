"""The paper's method: Algorithms 1 and 2, equations 2 to 5."""
