"""Early end of a run, as commands print it with `--json`."""

from typing import Literal, NotRequired

from rig.records import ContactKind
from rig_shared.outputs import CommandLine, Output

Left = Literal["lifted", "raised", "held", "not moved"]


class IndentorAtEndJson(Output):
    """Final position of the indentor."""

    left: Left
    x_mm: float | None
    height_mm: float | None
    trusted: bool
    may_touch: bool | None
    contact: ContactKind | None
    force_gwt: float | None
    measured_unix_s: float | None
    aged: bool


class EndingJson(Output):
    """Why a run ended early. A run whose journal has an end has no more than `reason_text` and `where_text`."""

    reason_text: str
    where_text: str | None
    indentor: NotRequired[IndentorAtEndJson]
    next_text: NotRequired[str]
    resume: NotRequired[CommandLine | None]
    """Command that continues the run; null if it never began."""
