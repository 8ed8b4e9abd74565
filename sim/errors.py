"""The base of every error of the simulation: one sentence, a code that does not change with it, and its fields."""

from typing import Any, ClassVar


class SimError(Exception):
    """An error with a stable code.

    Parameters
    ----------
    sentence : str
        What went wrong, where, and what to do. With `fields` it is a format string over them: "{shape}: {doi_mm:g} mm
        is deeper than {most_mm:g} mm". Without fields it is printed as it is, so plain text needs no care.
    code : str, optional
        What went wrong, for programs: lower case, with underscores. The class's own `default_code` if not given.
    **fields
        Numbers in the unit that their name ends with, names, and choices.
    """

    default_code: ClassVar[str] = "error"

    def __init__(self, sentence: str = "", /, *, code: str | None = None, **fields: Any) -> None:
        super().__init__(sentence.format_map(fields) if fields else sentence)
        self.sentence, self.fields = sentence, fields
        self.code = self.default_code if code is None else code

    def __reduce__(self) -> tuple[Any, ...]:
        return _raised_again, (type(self), self.args), self.__dict__


class ArgumentError(SimError, ValueError):
    """An argument that only a caller in Python can get wrong."""

    default_code = "bad_argument"


def _raised_again(kind: type[SimError], args: tuple[Any, ...]) -> SimError:
    error = kind.__new__(kind)
    error.args = args
    return error
