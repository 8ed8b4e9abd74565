"""Bad input, told in one line: what, where, and what was expected."""

from pydantic import ValidationError


class BadInputError(Exception):
    """Something the user gave is not usable; nothing has moved."""


def first_problem(where: str, error: ValidationError) -> BadInputError:
    """The first complaint of a validation, with the place and the value it is about."""
    problem = error.errors()[0]
    place = ".".join(str(part) for part in problem["loc"])
    if problem["type"] == "extra_forbidden":
        return BadInputError(f"{where}: {place}: there is no such key")
    return BadInputError(f"{where}: {place} = {problem['input']!r}: {problem['msg'].lower()}")
