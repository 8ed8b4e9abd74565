"""What moves: the stage, whatever controller drives it."""

from rig.stage.base import (
    Axis,
    Stage,
    StageAlarm,
    StageError,
    StageRejected,
    StageReset,
    StageStatus,
    StageTimeout,
)
from rig.stage.grbl import GrblStage

__all__ = [
    "Axis",
    "GrblStage",
    "Stage",
    "StageAlarm",
    "StageError",
    "StageRejected",
    "StageReset",
    "StageStatus",
    "StageTimeout",
]
