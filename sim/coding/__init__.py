"""Encoding and decoding (Raju 1998, ch. 6): pressure on the skin to receptors under it, and back.

- `skin_line`: the section's skin as a line, and strain in axes along it. `sampled_section`: the section with
  receptors under equally spaced places, or anywhere. `energy`: strain energy density as a sum of squares.
- `impulse`: the responses h, g, f to a point load, their spectra, and what shifting them misses.
- `operators`: pressure to SED, by convolution or by finite-element influence. `borne`: what a press bears on the
  skin. `encoding`: noise and receptors.
- `frictionless`: pressures that lean as the skin does under them.
- `point_spread`: how SED spreads under equal point loads all over the pulp of the whole finger.
- `sheets`: the whole finger's pressures, under a named axial shape or over x and z.
- `univariate`, `other_searches`: the source's decoder and cheap others. `profile_decoder`: ours, with a band (its
  parts in `profiles/`), from `readings`, through a `fitted_receptor` too; `decoded` says how wrong an answer is.
"""
