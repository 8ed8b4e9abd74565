"""Conversion constants; inside the model everything is in mm, N and MPa."""

GWT_N = 9.80665e-3
"""Newtons per gram-weight (standard gravity)."""

PSEUDO_E_EPIDERMIS = 1.0e4
"""Young's modulus of the epidermis in the pseudo-units of Raju (1998, ch. 3), who states only ratios of E."""
