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

__all__ = [
    "ForceBroken",
    "ForceBusy",
    "ForceError",
    "ForceOverload",
    "ForceReading",
    "ForceSensor",
    "ForceTimeout",
    "ForceUnderload",
]
