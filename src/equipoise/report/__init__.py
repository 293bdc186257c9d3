"""A page to read and to show."""
