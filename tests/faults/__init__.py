"""Faults that tests and studies share."""
