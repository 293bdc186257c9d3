"""The posterior's residuals in units of their own noise: one block per kind of evidence, and the table of them."""
