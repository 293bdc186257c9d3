"""What the robot felt: validated streams, and their storage."""
