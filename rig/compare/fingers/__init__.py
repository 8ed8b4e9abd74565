"""Comparisons that hold for every finger within stated ranges."""
