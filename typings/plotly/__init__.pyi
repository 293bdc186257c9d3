"""Covers what equipoise uses of Plotly."""
