"""Units at the edges of the controller; inside it everything is mm, N and s."""

GWT_N = 9.80665e-3
"""Newtons in one gram-weight (standard gravity)."""

UNITS = {
    "steps_per_mm": "steps/mm",
    "mm_per_n": "mm/N",
    "kpa": "kPa",
    "mm_s2": "mm/s²",
    "mm_s": "mm/s",
    "gwt": "gwt",
    "deg": "°",
    "rpm": "1/min",
    "mm": "mm",
    "um": "µm",
    "ms": "ms",
    "gb": "GB",
    "baud": "bit/s",
    "s": "s",
    "n": "N",
    "nm": "N·m",
    "bits": "bit",
    "g": "g",
}
"""Units by the end of a name."""


def unit_of_key(name: str) -> str:
    """Return the unit of a key or column by the end of its name; empty without one."""
    return next((unit for end, unit in UNITS.items() if name == end or name.endswith(f"_{end}")), "")
