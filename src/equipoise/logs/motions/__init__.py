"""What a long recording holds: rests, moves, sways, lifts and walks."""
