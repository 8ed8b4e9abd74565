"""Meeting fingers of which only the bench knows the truth: how far off, how wide, how often flagged."""
