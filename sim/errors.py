"""What a model refuses."""

import math

from sim.errors import SimError


class ModelRangeError(SimError, ValueError):
    """What is asked for lies outside what the model can answer."""

    default_code = "out_of_range"


class ForceOutOfReachError(ModelRangeError):
    """The force is not reached at the deepest indentation that the model answers."""

    default_code = "force_out_of_reach"


def refuse_unless_one(doi_mm: float | None, force_gwt: float | None) -> None:
    """Refuse both a depth and a force, and neither. Raises ModelRangeError."""
    if (doi_mm is None) == (force_gwt is None):
        raise ModelRangeError(
            "expected exactly one of a depth (doi_mm) and a force (force_gwt)",
            code="not_one_target",
            doi_mm=doi_mm,
            force_gwt=force_gwt,
        )


def z_outside(z_mm: float, length_mm: float) -> ModelRangeError:
    """Of a place beyond an end of the finger."""
    return ModelRangeError(
        "z = {z_mm} mm: expected 0 … {length_mm:g} mm along the finger",
        code="z_outside",
        z_mm=z_mm,
        length_mm=length_mm,
    )


def positive(force_gwt: float) -> float:
    """A force that can be asked for. Raises ModelRangeError."""
    if not (math.isfinite(force_gwt) and force_gwt > 0):
        raise ModelRangeError(
            "force {force_gwt:g} gwt: expected a positive number", code="force_not_positive", force_gwt=force_gwt
        )
    return force_gwt
