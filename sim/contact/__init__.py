"""Rigid frictionless contact on a condensed patch.

A shape is a profile (`profiles`, `measured_profile`, named in `shapes`) carried along, across or around (`indentor`).
`solver` iterates: planes frozen at the displaced points (`points`, `planes`), an exact convex solve (`lcp`), a Newton
slip (`newton`). `touch` finds the height of first contact, `force_control` the depth at which a force is reached.
"""
