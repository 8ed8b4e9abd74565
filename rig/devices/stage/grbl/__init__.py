"""A stage behind a GRBL 1.1 board, or one with grblHAL."""
