"""What an estimate says of the robot's sensors, of what it takes for the model's, and of lifts that it has not seen."""
