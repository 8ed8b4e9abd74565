"""Errors of the simulation."""

import math

import numpy as np

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


def is_plain_number(value: object) -> bool:
    """Return whether a value is an int or a float, of Python or numpy, without a unit; True and False are none."""
    if isinstance(value, np.generic):
        return value.dtype.kind in "iuf"
    return isinstance(value, int | float) and not isinstance(value, bool) and not has_unit(value)


def has_unit(value: object) -> bool:
    """Return whether a value is a quantity, as of `quantities`, `pint`, `astropy` or `unyt`."""
    return any(hasattr(value, name) for name in ("units", "unit", "dimensionality"))


def refuse_unless_numbers(**arguments: object) -> None:
    """Raise ArgumentError for arguments that are not one number each; True, False and quantities are none."""
    for name, value in arguments.items():
        if not is_plain_number(value):
            raise ArgumentError(
                f"{name}: must be one number, an int or a float in the unit of the name, not {type(value).__name__}; "
                "indent_many takes arrays and lists",
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
