"""What follows from recordings. Nothing here moves anything."""
