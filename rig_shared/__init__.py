"""What `rig` and `sim` share, on the standard library alone: reading of files that somebody else may have made."""
