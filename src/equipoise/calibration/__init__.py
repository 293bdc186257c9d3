"""A calibration from its settings to its run folder, and what several of them say together."""
