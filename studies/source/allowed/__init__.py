"""Which fingers the source allows: history matching of what the 24 published points leave open."""
