"""Shift invariance: how SED spreads under equal point loads all over the pulp of the finger (Raju 1998, §6.3).

- `sites`: where the source loads its finger, and its Table 6.1. `loaded_finger`: unit forces on the skin of the whole
  finger, and the strain under them. `receptor_sheet`: receptors at one depth all over the pulp.
- `power_law`: fits of A / r^m. `spreads`: SED about each site, its fit and its symmetry.
- `moved_response`: one site's response moved to where another load or a press is, against finite elements.
"""
