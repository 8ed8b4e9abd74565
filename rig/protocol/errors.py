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
    message = problem["msg"].removeprefix("Value error, ")
    if isinstance(problem["input"], dict):  # about a whole table: the message says which keys
        return BadInputError(": ".join(part for part in (where, place, message) if part))
    return BadInputError(f"{where}: {place} = {problem['input']!r}: {message.lower()}")
