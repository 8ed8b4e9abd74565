"""Units at the edges of the controller; inside it everything is mm, N and s."""

GWT_N = 9.80665e-3
"""Newtons in one gram-weight (standard gravity)."""
