"""What stands between a command and a robot that can break."""
