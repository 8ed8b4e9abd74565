"""Elements, assembly and condensation."""
