"""What feels: the force sensor, whatever instrument it is."""

from rig.force.base import (
    ForceBusy,
    ForceError,
    ForceOverload,
    ForceReading,
    ForceSensor,
    ForceTimeout,
    ForceUnderload,
)
from rig.force.mtsics import MtSicsForce

__all__ = [
    "ForceBusy",
    "ForceError",
    "ForceOverload",
    "ForceReading",
    "ForceSensor",
    "ForceTimeout",
    "ForceUnderload",
    "MtSicsForce",
]
