"""Measurement models of lifts, stance motions and torques for the Bayesian method."""
