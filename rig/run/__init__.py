"""The engine: it moves the stage one safe increment at a time, reads the force and journals what happens."""

from rig.run.engine import Engine
from rig.run.errors import EngineError, LimitError, NotReadyError, RecordError, RunAborted, ScriptError, TripError
from rig.run.indent import indent
from rig.run.journal import Journal
from rig.run.operator import Operator
from rig.run.records import Hold, Indentation, PressId, Target

__all__ = [
    "Engine",
    "EngineError",
    "Hold",
    "Indentation",
    "Journal",
    "LimitError",
    "NotReadyError",
    "Operator",
    "PressId",
    "RecordError",
    "RunAborted",
    "ScriptError",
    "Target",
    "TripError",
    "indent",
]
