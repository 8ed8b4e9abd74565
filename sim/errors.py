"""Base class of all simulation errors: a sentence, a stable code, and fields."""

import math
from typing import Any, ClassVar


class SimError(Exception):
    """An error with a stable code.

    With `fields`, `sentence` is a format string over them: "{shape}: {doi_mm:g} mm is deeper than {most_mm:g} mm".
    Without fields it is printed as it is. `code` is lower case, with underscores; default: the class's
    `default_code`.
    """

    default_code: ClassVar[str] = "error"

    def __init__(self, sentence: str = "", /, *, code: str | None = None, **fields: Any) -> None:
        super().__init__(sentence.format_map(fields) if fields else sentence)
        self.sentence, self.fields = sentence, fields
        self.code = self.default_code if code is None else code

    def __reduce__(self) -> tuple[Any, ...]:
        return _raised_again, (type(self), self.args), self.__dict__


class ArgumentError(SimError, ValueError):
    """Error of an argument that only Python callers can get wrong."""

    default_code = "bad_argument"


def _raised_again(kind: type[SimError], args: tuple[Any, ...]) -> SimError:
    error = kind.__new__(kind)
    error.args = args
    return error


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
        sentence = "{name}: must be one number, not {kind}; indent_many takes arrays and lists"
        raise ArgumentError(sentence, code="not_a_number", name=name, kind=type(value).__name__)


def refuse_unless_one(doi_mm: float | None, force_gwt: float | None) -> None:
    """Raise ModelRangeError for both a depth and a force, and for neither."""
    found = {"doi_mm": doi_mm, "force_gwt": force_gwt}
    refuse_unless_numbers(**{name: value for name, value in found.items() if value is not None})
    if (doi_mm is None) == (force_gwt is None):
        raise ModelRangeError(
            "give exactly one of a depth (doi_mm) and a force (force_gwt)",
            code="not_one_target",
            doi_mm=doi_mm,
            force_gwt=force_gwt,
        )


def z_outside(z_mm: float, length_mm: float) -> ModelRangeError:
    """Return the error of a position beyond an end of the finger."""
    return ModelRangeError(
        "z = {z_mm} mm: must be 0 to {length_mm:g} mm along the finger",
        code="z_outside",
        z_mm=z_mm,
        length_mm=length_mm,
    )


def positive(force_gwt: float) -> float:
    """Return a force that is positive and finite. Raises ModelRangeError."""
    if not (math.isfinite(force_gwt) and force_gwt > 0):
        raise ModelRangeError(
            "force {force_gwt:g} gwt: must be a positive number", code="force_not_positive", force_gwt=force_gwt
        )
    return force_gwt
