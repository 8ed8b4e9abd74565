"""Sizes that an indentor of a file or of arrays may have: outside them its numbers are in another unit."""

from sim.config import MESH_LEVELS

_FINEST_MM = float(MESH_LEVELS["fine"]["spacing_mm"])
NARROWEST_MM = _FINEST_MM
"""Least width (mm): one element of the level `fine`. A narrower indentor lies between the nodes of the skin."""
WIDEST_MM = 200.0
FLATTEST_MM = _FINEST_MM / 20
"""Least relief (mm) of an indentor that is not flat: a smaller one changes the force on a flat face of 3 mm by
less than 1 % (section and half-space, DOI 0.1 to 1 mm), less than the mesh does."""
TALLEST_MM = 20.0
"""Largest relief (mm): ten times the deepest press, so that higher points never touch."""
_FLAT_MM = 1e-6
_ROUNDED_MM = 1e-9


def wrong_size(width_mm: float, relief_mm: float, of: str = "x_mm") -> tuple[str, str] | None:
    """Return what is wrong with the size of an indentor, with the likely unit, and its code; None if nothing is."""
    if not NARROWEST_MM - _ROUNDED_MM <= width_mm <= WIDEST_MM + _ROUNDED_MM:
        small = width_mm < NARROWEST_MM
        return (
            f"{of} spans {width_mm:.4g} mm; must be {NARROWEST_MM:g}, an element of the finest mesh, to "
            f"{WIDEST_MM:g} mm; {_unit(small)}"
        ), "too_narrow" if small else "too_wide"
    if _FLAT_MM < relief_mm < FLATTEST_MM - _ROUNDED_MM or relief_mm > TALLEST_MM + _ROUNDED_MM:
        small = relief_mm < FLATTEST_MM
        return (
            f"the heights span {relief_mm:.4g} mm; must be 0, or {FLATTEST_MM:g}, a 20th of an element of the finest "
            f"mesh, to {TALLEST_MM:g} mm, beyond which nothing touches; {_unit(small)}"
        ), "too_flat" if small else "too_tall"
    return None


def _unit(small: bool) -> str:
    return f"lengths are in mm: {'multiply meters by 1000' if small else 'divide micrometers by 1000'}"
