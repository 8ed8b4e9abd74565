"""Pressure on the skin of the whole finger: along a row under a named axial shape, and over x and z from a sheet.

- `felt_skin`: the finger with receptors anywhere, under any pressures on its skin.
- `axial_row`: a row of receptors, decoded as pressures across x that vary along z as they are told.
- `sheet_operator`: pressures over x and z that lean as the skin does under them. `sheet_decoder`: those that explain
  readings, with a band. `felt_solid`: class, size and extent of what lies on the skin there.
"""
