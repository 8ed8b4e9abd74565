"""A finger that the rig has met: its file, and what it expects of a press with a band."""
