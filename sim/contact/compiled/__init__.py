"""Loops over the points of a contact, compiled for the machine at hand."""
