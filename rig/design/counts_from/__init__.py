"""Where the counts of an adaptive run come from: one module for each source."""
