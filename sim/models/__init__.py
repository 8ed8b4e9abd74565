"""Fingertips to be indented: finger, section and half-space behind one interface.

`catalogue` is the door: `load(name)` gives a `Fingertip` (`fingertip`), which places an indentor, presses it
(`pressing`) and returns a `result`, which knows no model. Behind it is a `CondensedModel` (`condensed`)
made by a builder: `finger_3d` and `section` from a mesh, `halfspace` from formulas. A new
model is a module with a builder, and a name and a line in `catalogue`. `cache` keeps made models on disk, `sources`
makes larger ones where a scene needs them. Beside these: `strain_at_points` anywhere in a pressed finger, by the
`factored_interior` of its mesh; `full_mesh`, the finger for CalculiX; `many_indentations` by one call.
"""
