"""Encoding and decoding (Raju 1998, ch. 6): pressure on the skin to receptors under it, and back.

From the top: `task` does all that `rig encode` and `rig decode` do, a task in and a result out, and `readings_file`
reads what a user has measured. The parts by themselves:

- `section`: the finger's plane-strain section, its skin as a line, receptors anywhere, strain energy density (SED).
- `operators`: impulse responses h, g, f, and pressure to SED by convolution or by finite-element influence.
- `pressure`: what a press bears on the skin; pressures that lean as the skin does under them.
- `encoding`: noise and receptors. `readings`: what receptors hand to a decoder.
- `decoding`: what all decoders share. `decoders_by_search`: the source's decoder and cheap others. `bayes`: the
  default; `contact_search`, `model_averaging` and `evidence` are its parts.
- `sheet`: the whole finger's pressures, under a named axial shape or over x and z. `shape_class`: what touches.
- `point_loaded_finger`, `power_law`, `point_spread`, `raju_table_6_1`: how SED spreads under equal point loads all
  over the pulp.
"""
