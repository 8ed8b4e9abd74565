"""Tissue that stiffens with strain."""
