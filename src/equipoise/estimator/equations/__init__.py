"""Equations of the estimate, one in each module, and the table of them."""
