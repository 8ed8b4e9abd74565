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
from rig.stage.leadshine import LeadshineStage
from rig.stage.leadshine_drive import LeadshineDrive

__all__ = [
    "Axis",
    "GrblStage",
    "LeadshineDrive",
    "LeadshineStage",
    "Stage",
    "StageAlarm",
    "StageError",
    "StageRejected",
    "StageReset",
    "StageStatus",
    "StageTimeout",
]
