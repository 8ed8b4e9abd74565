"""Finite-element fingertip and virtual devices."""
