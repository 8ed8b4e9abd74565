"""Fingertip models: finger, section and half-space behind one interface.

`catalogue.load(name)` returns a `Fingertip` (`fingertip`), which places an indentor, presses it (`pressing`) and
returns a result, which knows no model. Behind it is a `CondensedModel` (`condensed`) from a builder:
`finger_3d` and `section` build it from a mesh, `halfspace` from formulas. A new model is a module with a builder,
and a name and a line in `catalogue`. `cache` stores models; `sources` builds larger patches when contact needs
them. `strain_at_points` evaluates strains anywhere in a pressed finger, by the `factored_interior` of its mesh;
`full_mesh` exports to CalculiX; `many_indentations` presses in many processes.
"""
