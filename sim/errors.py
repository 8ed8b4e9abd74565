"""Errors of the simulation."""

import math

from rig_shared.errors import CodedError


class SimError(CodedError):
    """Error of the simulation."""


class ArgumentError(SimError, ValueError):
    """Error of an argument that only Python callers can get wrong."""

    default_code = "bad_argument"


# --- model errors ---


class ModelRangeError(SimError, ValueError):
    """Error of a request outside the range of a model."""

    default_code = "out_of_range"


class ForceOutOfReachError(ModelRangeError):
    """Error of a force that is not reached at the deepest allowed indentation."""

    default_code = "force_out_of_reach"


def refuse_unless_numbers(**arguments: object) -> None:
    """Raise ArgumentError for arguments that are not one number each; True and False are none."""
    for name, value in arguments.items():
        if not isinstance(value, (str, bytes, bool)) and str(getattr(value, "dtype", "")) != "bool":
            try:
                float(value)  # type: ignore[arg-type]
                continue
            except (TypeError, ValueError):
                pass
        raise ArgumentError(
            f"{name}: must be one number, not {type(value).__name__}; indent_many takes arrays and lists",
            "not_a_number",
        )


def refuse_unless_one(doi_mm: float | None, force_gwt: float | None) -> None:
    """Raise ModelRangeError for both a depth and a force, and for neither."""
    found = {"doi_mm": doi_mm, "force_gwt": force_gwt}
    refuse_unless_numbers(**{name: value for name, value in found.items() if value is not None})
    if (doi_mm is None) == (force_gwt is None):
        raise ModelRangeError("give exactly one of a depth (doi_mm) and a force (force_gwt)", "not_one_target")


def z_outside(z_mm: float, length_mm: float) -> ModelRangeError:
    """Return the error of a position beyond an end of the finger."""
    return ModelRangeError(f"z = {z_mm} mm: must be 0 to {length_mm:g} mm along the finger", "z_outside")


def positive(force_gwt: float) -> float:
    """Return a force that is positive and finite. Raises ModelRangeError."""
    if not (math.isfinite(force_gwt) and force_gwt > 0):
        raise ModelRangeError(f"force {force_gwt:g} gwt: must be a positive number", "force_not_positive")
    return force_gwt
