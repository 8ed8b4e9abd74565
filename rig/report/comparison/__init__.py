"""The report of a comparison with recordings."""
