"""Recordings that are not ours: read from bags and tables, and cut into what can be used."""
