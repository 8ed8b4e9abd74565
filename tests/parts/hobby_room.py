"""A hobby board."""
