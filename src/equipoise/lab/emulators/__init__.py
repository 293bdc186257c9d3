"""Emulators: simulated robots with the protocol of a real robot, in their own process, to test drivers."""
