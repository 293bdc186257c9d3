"""What an estimate says of the robot's sensors, and of what it takes for the model's."""
