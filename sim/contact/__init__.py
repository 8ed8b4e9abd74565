"""Rigid frictionless contact on a condensed patch.

A shape is a profile (`profiles`, `measured_profile`, named in `shapes`) carried along, across or around (`indentor`).
`solver` iterates: planes frozen at the displaced points (`points`, `planes`), an exact convex solve (`lcp`), Newton's
slip (`newton`). `touch` says where the depth is zero, `control` at which depth a force is reached.
"""
