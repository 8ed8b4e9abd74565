"""The private socket of whoever owns the ports: it announces itself, and answers whatever its main thread does."""
