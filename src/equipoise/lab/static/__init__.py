"""Static baseline: CoM and mass from the foot forces of the standing robot."""
