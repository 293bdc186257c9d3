"""What was found, how sure it is, and how it is kept."""
