"""Identification of fingers whose truth only the bench knows: errors, width of the bands, fingers flagged."""
