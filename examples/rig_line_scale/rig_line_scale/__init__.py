"""A scale that speaks lines, for the indentation rig."""
