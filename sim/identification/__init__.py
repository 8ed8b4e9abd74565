"""Bayesian identification of a finger: its prior, the predicted forces, and the posterior."""
