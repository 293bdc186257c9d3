"""Checks of an estimate, findings about sensors and links, and predictions of lifts that were left out."""
