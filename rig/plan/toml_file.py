"""What can be wrong with a TOML file that a user wrote, in one line."""

import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from pydantic import ValidationError

from rig.errors import RigError


@contextmanager
def told_of(where: str, error: Callable[..., RigError]) -> Iterator[None]:
    """Raise as `error`, beginning with where, what reading and validating a TOML file may raise."""
    try:
        yield
    except OSError as problem:
        what = str(problem.strerror or problem)
        raise error("{where}: {problem}", code="unreadable", where=where, problem=what) from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as problem:
        raise error("{where}: {problem}", code="no_toml", where=where, problem=str(problem)) from None
    except ValidationError as problem:
        first = problem.errors()[0]
        raise error(
            "{where}: {key}: {problem}",
            code="invalid_value",
            where=where,
            key=".".join(map(str, first["loc"])),
            rule=first["type"],
            problem=first["msg"].removeprefix("Value error, "),
        ) from None
