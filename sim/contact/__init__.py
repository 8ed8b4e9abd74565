"""Rigid frictionless contact on a condensed patch."""
