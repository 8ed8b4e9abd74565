"""Runs against the model and against recordings: responses, fits, sets, studies over many processes."""
