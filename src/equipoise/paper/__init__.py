"""The paper's method: Algorithms 1 and 2 in `com_search.py`, equations 2 to 5 in `equations.py`."""
