"""Covers what equipoise uses of SciPy."""
