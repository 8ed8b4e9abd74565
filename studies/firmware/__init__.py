"""What GRBL firmware does, recorded from a port, and the virtual board held against it."""
