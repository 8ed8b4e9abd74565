"""Benches: real devices, virtual ones on a virtual clock, or virtual ones behind ports."""
