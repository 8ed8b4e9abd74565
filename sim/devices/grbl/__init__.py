"""Virtual GRBL 1.1 board."""
