"""Motions that all methods share: standing up, stance motions, lifts, excitations, and the end of a lift."""
