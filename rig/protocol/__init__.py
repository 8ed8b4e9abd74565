"""Protocol scripts: parameters, the check before anything moves, and the verbs."""

from pydantic import Field

from rig.protocol.api import ProtocolParameters, Rig

__all__ = ["Field", "ProtocolParameters", "Rig"]
