"""Motions in a long recording: rests, moves, excitations, lifts and walks."""
