"""Guard: the checks between a command and a robot that can break."""
