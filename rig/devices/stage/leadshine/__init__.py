"""A stage of two Leadshine drives without a board between."""
