"""Engine: moves the stage one increment at a time, reads the force, and journals every event."""

from typing import TYPE_CHECKING

from rig import door

if TYPE_CHECKING:
    from rig.data.journal import Journal
    from rig.engine.bench import Bench, Operator, Pause, WatchedBench
    from rig.engine.engine import Engine
    from rig.engine.indentation import indent
    from rig.errors import EngineError, LimitError, NotReadyError, RecordError, RunAborted, ScriptError, TripError
    from rig.records import Hold, Indentation, PressId, Target

__all__ = [
    "Bench",
    "Engine",
    "EngineError",
    "Hold",
    "Indentation",
    "Journal",
    "LimitError",
    "NotReadyError",
    "Operator",
    "Pause",
    "PressId",
    "RecordError",
    "RunAborted",
    "ScriptError",
    "Target",
    "TripError",
    "WatchedBench",
    "indent",
]

__getattr__ = door(
    __name__,
    {
        "rig.engine.bench": (
            "Bench",
            "Operator",
            "Pause",
            "WatchedBench",
        ),
        "rig.engine.engine": ("Engine",),
        "rig.errors": (
            "EngineError",
            "LimitError",
            "NotReadyError",
            "RecordError",
            "RunAborted",
            "ScriptError",
            "TripError",
        ),
        "rig.data.journal": ("Journal",),
        "rig.engine.indentation": ("indent",),
        "rig.records": (
            "Hold",
            "Indentation",
            "PressId",
            "Target",
        ),
    },
)
