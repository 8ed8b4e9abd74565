"""A virtual GRBL 1.1 board."""
