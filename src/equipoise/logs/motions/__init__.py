"""Motions in a long recording: rests, moves, sways, lifts and walks."""
