"""Identify the finger under the rig from a few gentle presses."""
