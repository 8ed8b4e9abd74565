"""Errors are told apart by their class, code and fields."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from rig.errors import RigError
from sim.errors import SimError


@contextmanager
def raises(kind: type[RigError] | type[SimError], code: str, /, **fields: Any) -> Iterator[pytest.ExceptionInfo[Any]]:
    """Expect an error of a class with this code; fields that are named must be equal, floats to 1e-9 or as approx."""
    with pytest.raises(kind) as caught:
        yield caught
    has_code(caught.value, code, **fields)


def has_code(error: BaseException, code: str, /, **fields: Any) -> None:
    """Assert the code of an error, and those of its fields that are named."""
    assert isinstance(error, (RigError, SimError)), repr(error)
    assert error.code == code, f"{error.code}: {error}"
    for name, value in fields.items():
        assert name in error.fields, f"{name} is none of {sorted(error.fields)}: {error}"
        expected = pytest.approx(value, rel=1e-9, abs=1e-12) if isinstance(value, float) else value
        assert error.fields[name] == expected, f"{name}: {error}"
