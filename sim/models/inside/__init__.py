"""Strain inside a finger: columns of places, adjoint solves that make them, the whole mesh for clouds of points."""
