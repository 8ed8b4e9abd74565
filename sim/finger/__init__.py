"""Geometry and mesh of the fingertip."""
