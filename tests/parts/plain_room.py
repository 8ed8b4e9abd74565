"""A scale that answers in plain numbers."""
