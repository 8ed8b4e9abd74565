"""The base of every error of the rig: one sentence, a code that does not change with it, and its fields."""

import re
from typing import Any, ClassVar, TypeVar


class RigError(Exception):
    """An error with a stable code.

    Parameters
    ----------
    sentence : str
        What went wrong, where, and what to do. With `fields` it is a format string over them: "{port}: no reply to
        {command} within {timeout_s:g} s". Without fields it is printed as it is, so a driver may raise plain text.
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


class RuleError(RigError, ValueError):
    """Values that do not go together, found by a validator; code and fields survive the validation."""

    default_code = "invalid_value"


Coded = TypeVar("Coded", bound=RigError)


def code_of(error: BaseException) -> str:
    """The code of an error: its own, or for one of another library the name of its class (`file_not_found`).

    An error of the simulation has its own too: packages below this one cannot be imported here.
    """
    code = getattr(error, "code", None)
    if isinstance(code, str) and not isinstance(error, SystemExit):
        return code
    name = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", type(error).__name__).lower()
    return name if name == "os_error" else name.removesuffix("_exception").removesuffix("_error")


def is_coded(error: Any) -> bool:
    """Whether it is an error with code and fields, of the rig or of the simulation, which is not imported here."""
    return isinstance(getattr(error, "fields", None), dict) and isinstance(getattr(error, "code", None), str)


def around(kind: type[Coded], sentence: str, error: Any, /, *, code: str | None = None, **fields: Any) -> Coded:
    """Return an error that has the sentence of another one in its own, as {problem}, and its code and fields."""
    known = error.fields if is_coded(error) else {}
    kept = error.code if code is None and is_coded(error) else code
    return kind(sentence, code=kept, **{**known, **fields, "problem": str(error)})


def recast(kind: type[Coded], error: Exception) -> Coded:
    """Return the same words, code and fields as an error of another kind; of one that has words alone, these."""
    if isinstance(error, RigError):
        return kind(error.sentence, code=error.code, **error.fields)
    return kind(str(error))


def fields_of(error: BaseException) -> dict[str, Any]:
    """The fields of an error; none of one that has none."""
    return dict(getattr(error, "fields", {}))


def _raised_again(kind: type[RigError], args: tuple[Any, ...]) -> RigError:
    error = kind.__new__(kind)
    error.args = args
    return error
