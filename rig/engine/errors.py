"""How a run ends before its end."""

from typing import TypeVar

from rig.errors import RigError

_E = TypeVar("_E", bound=RigError)


class EngineError(RigError):
    """The engine did not do what it was told."""

    default_code = "engine_failed"


class LimitError(EngineError):
    """A step lies beyond a limit; nothing was moved for it."""

    default_code = "beyond_limit"


class NotReadyError(EngineError):
    """The verb is not allowed in the present state."""

    default_code = "not_allowed"


class TripError(EngineError):
    """A reading passed a trip: the stage was stopped and stays stopped until an operator resets it."""

    default_code = "tripped"


class RecordError(EngineError):
    """The journal cannot be written: what is not recorded must not go on."""

    default_code = "not_recorded"


class LostRecordError(RecordError):
    """The journal or the byte log is no longer at its path: what is written to it would not be found."""

    default_code = "record_lost"


class PressPaused(EngineError):  # noqa: N818
    """The operator paused during an indentation and goes on: it begins again, from clearance."""

    default_code = "press_paused"


class RunAborted(EngineError):  # noqa: N818
    """The operator asked to stop; the indentor was lifted at the next safe point."""

    default_code = "run_aborted"


class ScriptError(EngineError):
    """The protocol script itself failed while it was carried out."""

    default_code = "script_failed"


def recast(kind: type[_E], error: Exception) -> _E:
    """The same words, code and fields as an error of another kind; of one that has words alone, these."""
    if isinstance(error, RigError):
        return kind(error.sentence, code=error.code, **error.fields)
    return kind(str(error))


def code_of(error: Exception) -> str:
    """The code of an error that another one ends with."""
    return error.code if isinstance(error, RigError) else RigError.default_code
