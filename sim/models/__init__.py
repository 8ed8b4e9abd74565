"""Fingertips to be indented: finger, section and half-space behind one interface."""
