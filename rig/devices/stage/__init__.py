"""What moves: the stage, whatever controller drives it."""

from rig.devices.stage.base import (
    Axis,
    Stage,
    StageAlarm,
    StageError,
    StageRejected,
    StageReset,
    StageStatus,
    StageTimeout,
)

__all__ = [
    "Axis",
    "Stage",
    "StageAlarm",
    "StageError",
    "StageRejected",
    "StageReset",
    "StageStatus",
    "StageTimeout",
]
