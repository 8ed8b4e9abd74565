"""How a run ends before its end."""

from rig.errors import RigError


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
