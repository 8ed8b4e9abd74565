"""Units at the edges of the controller; inside it everything is mm, N and s."""

from rig_shared.outputs import UNITS

GWT_N = 9.80665e-3
"""Newtons in one gram-weight (standard gravity)."""


def unit_of_key(name: str) -> str:
    """Return the unit of a key or column by the end of its name; empty without one."""
    return next((unit for end, unit in UNITS.items() if name == end or name.endswith(f"_{end}")), "")
