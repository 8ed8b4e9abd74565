"""Fingertips to be indented: finger, section and half-space behind one interface.

`catalogue` is the door: `load(name)` gives a `Fingertip` (`fingertip`), which places an indentor, presses it
(`pressing`) and returns one of the `results`, which know no model. Behind it is a `CondensedModel` (`condensed`)
made by a builder: `whole_finger` and `plane_section` from a mesh (`discretised`), `halfspace` from formulas. A new
model is a module with a builder, and a name and a line in `catalogue`. `cache` keeps made models on disk, `patches`
makes larger ones where a scene needs them. Beside these: `uncondensed`, strain everywhere in a section and the finger
for CalculiX; `processes`, models in processes of their own, and many presses by one call.
"""
