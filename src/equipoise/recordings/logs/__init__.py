"""Logs that are not ours: read from bags and tables, their joints mapped, their samples checked."""
