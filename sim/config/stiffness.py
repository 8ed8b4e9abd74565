"""The stiffness scale: the one number that turns pseudo-units into MPa."""

E_EPIDERMIS_MPA = 0.186266
"""Young's modulus of the epidermis.

Raju (1998) knows ratios of E only. His step 1 at x = −1.63 mm, pressed 0.73 mm deep, stands for a force of 8 gwt; on
the default mesh that makes E(epidermis) this number. `studies/source/stiffness_scale.py` prints it anew;
another geometry or mesh keeps it.
"""
