"""Scale with a line protocol, for the indentation rig."""
