"""Errors are told apart by their class and code; what a person needs to know stands in the sentence."""

import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from decimal import Decimal
from typing import Any

import pytest

from rig_shared.errors import CodedError, code_of

_NUMBER = re.compile(r"(?<![\w.])[-+−]?\d+(?:\.\d+)?(?:e[-+]?\d+)?", re.IGNORECASE)


@contextmanager
def raises(kind: type[CodedError], code: str, /, **shown: Any) -> Iterator[pytest.ExceptionInfo[Any]]:
    """Expect an error of a class with this code, whose sentence shows these values."""
    with pytest.raises(kind) as caught:
        yield caught
    has_code(caught.value, code, **shown)


def has_code(error: BaseException, code: str, /, **shown: Any) -> None:
    """Assert the code of an error, and that its sentence shows these values, numbers to the digits printed."""
    assert isinstance(error, CodedError), repr(error)
    assert error.code == code, f"{error.code}: {error}"
    for name, value in shown.items():
        assert shows(str(error), value), f"{name} = {value!r}: {error}"


def causes(error: BaseException) -> list[str]:
    """Return the codes of the errors that led to an error, the nearest first."""
    cause = error.__cause__ or error.__context__
    return [] if cause is None else [code_of(cause), *causes(cause)]


def printed(error: BaseException, before: str, after: str = "") -> float:
    """Return the number that stands between two texts in the sentence of an error."""
    found = re.search(f"{re.escape(before)}({_NUMBER.pattern}){re.escape(after)}", str(error), re.IGNORECASE)
    assert found is not None, f"no number between {before!r} and {after!r}: {error}"
    return float(found.group(1))


def shows(sentence: str, value: Any) -> bool:
    """Return whether a sentence shows a text, a number, or each value of a list."""
    if isinstance(value, (list, tuple, set, frozenset)):
        return all(shows(sentence, one) for one in value)
    if isinstance(value, (bool, str)) or value is None:
        return str(value) in sentence
    if not math.isfinite(getattr(value, "expected", value)):
        return str(value) in sentence
    return any(_is_printed(number, value) for number in _NUMBER.findall(sentence))


_MOST_DIGITS = 300


def _is_printed(number: str, value: Any) -> bool:
    printed = Decimal(number.replace("−", "-"))
    exponent = printed.as_tuple().exponent
    if abs(int(exponent)) > _MOST_DIGITS:  # no number, but a part of a name such as 5e774a
        return False
    half_digit = 0.5 * 10.0 ** int(exponent) if "." in number or "e" in number.lower() else 0.5e-9
    expected = getattr(value, "expected", value)
    return value == float(printed) or abs(float(printed) - float(expected)) <= 1.001 * half_digit
