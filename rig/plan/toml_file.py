"""What can be wrong with a TOML file that a user wrote, in one line."""

import tomllib
from collections.abc import Iterator
from contextlib import contextmanager

from pydantic import ValidationError


@contextmanager
def told_of(where: str, error: type[ValueError]) -> Iterator[None]:
    """Raise as `error`, beginning with where, what reading and validating a TOML file may raise."""
    try:
        yield
    except OSError as problem:
        raise error(f"{where}: {problem.strerror or problem}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as problem:
        raise error(f"{where}: {problem}") from None
    except ValidationError as problem:
        first = problem.errors()[0]
        place = ".".join(map(str, first["loc"]))
        raise error(f"{where}: {place}: {first['msg'].removeprefix('Value error, ')}") from None
