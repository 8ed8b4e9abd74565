"""Devices of a bench: stages, force sensors and the stop button."""
