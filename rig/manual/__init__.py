"""Move the stage by hand, guarded by force: from the terminal or through the panel."""
