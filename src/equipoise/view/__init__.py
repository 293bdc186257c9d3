"""A run in the browser, live or again."""
