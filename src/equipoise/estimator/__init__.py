"""From readings of recordings to the most probable unknowns: the table, the equations, the solution, the checks."""
