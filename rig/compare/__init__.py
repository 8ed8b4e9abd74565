"""Runs against the model and against recordings: shape tests, fits, intervals and sets."""
