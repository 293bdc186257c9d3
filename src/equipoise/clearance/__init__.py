"""Whether a robot's links keep clear of each other: simple bodies on them, and how near those come."""
