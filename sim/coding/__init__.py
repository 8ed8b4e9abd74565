"""Encoding and decoding (Raju 1998, ch. 6): pressure on the skin to receptors under it, and back.

`task` implements `rig encode` and `rig decode`, from a task to a result; `readings_file` reads measured data. Parts:

- `section`: plane-strain section, its skin as a line, receptors anywhere, strain energy density (SED).
- `operators`: impulse responses h, g, f, and pressure to SED by convolution or by finite-element influence.
- `pressure`: contact pressures of a press; pressures whose direction follows the deformed skin.
- `encoding`: noise and receptors. `readings`: input of decoders.
- `decoding`: what all decoders share. `decoders_by_search`: the source's decoder and simple others. `bayes`: the
  default; `contact_search`, `model_averaging` and `evidence` are its parts.
- `sheet`: pressures on the whole finger, with a given axial shape or over x and z. `shape_class`: indentor shapes.
- `point_loaded_finger`, `power_law`, `point_spread`, `raju_table_6_1`: spread of SED under equal point loads all over
  the pulp.
"""
