"""What feels: the force sensor, whatever instrument it is."""

from rig.devices.force.base import (
    ForceBroken,
    ForceBusy,
    ForceError,
    ForceOverload,
    ForceReading,
    ForceSensor,
    ForceTimeout,
    ForceUnderload,
)
from rig.devices.force.laumas import LaumasForce
from rig.devices.force.mtsics import MtSicsForce

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
