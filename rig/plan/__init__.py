"""Predictions of the finger model for a script: checks before a motion, and responses afterwards."""
