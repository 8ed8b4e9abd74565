"""Errors with a sentence for people and a code for programs."""

import copyreg
import re
from typing import Any, ClassVar


class CodedError(Exception):
    """An error whose code stays the same when its sentence changes.

    Parameters
    ----------
    sentence : str
        Where, what, and what is allowed; printed as it is.
    code : str, optional
        Lower case, with underscores. Default: the class's `default_code`.
    """

    default_code: ClassVar[str] = "error"
    run_status: ClassVar[str] = "failed"
    """State of a run that such an error ends."""
    remedy: ClassVar[str | None] = None
    """What the operator does next, if such an error ended a run."""

    def __init__(self, sentence: str = "", code: str | None = None) -> None:
        super().__init__(sentence)
        self.code = self.default_code if code is None else code

    def __reduce__(self) -> tuple[Any, ...]:
        return copyreg.__newobj__, (type(self), *self.args), self.__dict__  # type: ignore[attr-defined]


def code_of(error: BaseException) -> str:
    """Return the code of an error: its own, or the name of its class (`file_not_found`) for other libraries."""
    code = getattr(error, "code", None)
    if isinstance(code, str) and not isinstance(error, SystemExit):
        return code
    name = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", type(error).__name__).lower()
    return name if name == "os_error" else name.removesuffix("_exception").removesuffix("_error")
