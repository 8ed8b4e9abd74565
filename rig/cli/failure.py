"""JSON of a command that failed."""

from typing import Annotated, NotRequired

from rig.data.ending import EndingJson
from rig_shared.outputs import Code, Keywords, Output


class FailureJson(Output):
    """A command that failed."""

    error_text: str
    """The line on standard error. It may change; match `code`."""
    code: Code
    exit_code: Annotated[int, Keywords(enum=[1, 2, 130])]
    ending: NotRequired[EndingJson]
