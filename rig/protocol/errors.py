"""Bad input, told in one line: what, where, and what was expected."""

from reprlib import Repr

from pydantic import ValidationError

_SHORT = Repr()
_SHORT.maxlist = _SHORT.maxdict = 3
_SHORT.maxstring = _SHORT.maxother = 200


class BadInputError(Exception):
    """Something the user gave is not usable; nothing has moved."""


def first_problem(where: str, error: ValidationError) -> BadInputError:
    """The first complaint of a validation, with the place and the value it is about."""
    problem = error.errors()[0]
    place = ".".join(str(part) for part in problem["loc"])
    if problem["type"] == "extra_forbidden":
        return BadInputError(f"{where}: {place}: there is no such key")
    what = str(problem["ctx"]["error"]) if problem["type"] == "value_error" else problem["msg"].lower()
    if isinstance(problem["input"], dict):  # about a whole table: the message says which keys
        return BadInputError(": ".join(part for part in (where, place, what) if part))
    return BadInputError(f"{where}: {place} = {_SHORT.repr(problem['input'])}: {what}")
