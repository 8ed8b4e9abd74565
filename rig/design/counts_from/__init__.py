"""Sources of the counts of an adaptive run, one module each."""
