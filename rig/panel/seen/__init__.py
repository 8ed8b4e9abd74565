"""What a page is told of a run or of the bench: read, and never written to."""
