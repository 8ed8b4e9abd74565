"""How a run ended: the states that journals, lists, pages and JSON name."""

from collections.abc import Mapping
from enum import StrEnum
from typing import Annotated, Any, Never

from rig.errors import BadInputError
from rig_shared.errors import CodedError
from rig_shared.outputs import listed


class RunStatus(StrEnum):
    """State of a run."""

    DONE = "done"
    INCOMPLETE = "incomplete"
    ABORTED = "aborted"
    TRIPPED = "tripped"
    LIMITED = "limited"
    FAILED = "failed"
    KILLED = "killed"
    RUNNING = "running"

    @classmethod
    def _missing_(cls, value: object) -> Never:
        raise BadInputError(f"the state of a run is {value!r}: must be one of {', '.join(cls)}", "unknown_state")

    @classmethod
    def of_error(cls, error: BaseException) -> "RunStatus":
        """Return the state of a run that an error ended."""
        if isinstance(error, KeyboardInterrupt):
            return cls.ABORTED
        return cls(error.run_status) if isinstance(error, CodedError) else cls.FAILED

    @classmethod
    def of_journal(cls, stop: Mapping[str, Any] | None, missing: int) -> "RunStatus":
        """Return the state from the end of a journal, None without one, and the number of missing presses."""
        if stop is None:
            return cls.KILLED
        status = cls(stop["status"])
        return cls.INCOMPLETE if status is cls.DONE and missing else status


State = Annotated[str, listed(tuple(RunStatus))]

_REASONS = {
    RunStatus.INCOMPLETE: "the protocol ended before all planned indentations were done",
    RunStatus.KILLED: "the run has no end record: its program was killed or the power failed",
}


def reason_of(status: RunStatus, stop: Mapping[str, Any] | None = None) -> str:
    """Return why a run ended: what its journal says, else what the state means; empty for a run that is done."""
    return str((stop or {}).get("reason") or _REASONS.get(status, ""))
