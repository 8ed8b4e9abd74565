"""A Laumas load-cell transmitter."""
