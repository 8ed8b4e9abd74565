"""What feels: the force sensor, whatever instrument it is."""

from rig.force.base import (
    ForceBroken,
    ForceBusy,
    ForceError,
    ForceOverload,
    ForceReading,
    ForceSensor,
    ForceTimeout,
    ForceUnderload,
)
from rig.force.laumas import LaumasForce
from rig.force.mtsics import MtSicsForce

__all__ = [
    "ForceBroken",
    "ForceBusy",
    "ForceError",
    "ForceOverload",
    "ForceReading",
    "ForceSensor",
    "ForceTimeout",
    "ForceUnderload",
    "LaumasForce",
    "MtSicsForce",
]
