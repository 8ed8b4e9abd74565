"""Manual control of the stage, guarded by force: from the terminal or through the panel."""
