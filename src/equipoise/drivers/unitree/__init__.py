"""Unitree's robots: A1 and Go1 over UDP, Go2 and B2 over DDS."""
