"""Protocol scripts: parameters, the check before anything moves, and the verbs."""

from pydantic import Field

from rig.protocol.api import ProtocolParameters, Rig
from rig.protocol.schedule import Block, ReferencePress, Schedule, ScheduledParameters

__all__ = ["Block", "Field", "ProtocolParameters", "ReferencePress", "Rig", "Schedule", "ScheduledParameters"]
