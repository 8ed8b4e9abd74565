"""Figures of encoding and decoding."""
