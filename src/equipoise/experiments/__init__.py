"""What we make a robot do: lift trials, the search for the CoM, the sway."""
