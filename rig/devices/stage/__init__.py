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
from rig.devices.stage.grbl import GrblStage
from rig.devices.stage.leadshine import LeadshineStage
from rig.devices.stage.leadshine_drive import LeadshineDrive

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
