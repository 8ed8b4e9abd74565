"""Protocol scripts: parameters, verbs, and the check before a motion."""

from pydantic import Field

from rig.protocol.api import ProtocolParameters, Rig
from rig.protocol.schedule import (
    Block,
    RangeParameters,
    ReferencePress,
    Schedule,
    ScheduledParameters,
    about_the_centre,
)

__all__ = [
    "Block",
    "Field",
    "ProtocolParameters",
    "RangeParameters",
    "ReferencePress",
    "Rig",
    "Schedule",
    "ScheduledParameters",
    "about_the_centre",
]
