"""Which fingers a few presses leave possible: a prior, what each finger would answer, and the posterior."""
