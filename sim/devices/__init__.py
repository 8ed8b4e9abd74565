"""Virtual devices: they answer the same bytes as the real ones."""

from sim.devices.balance import VirtualBalance
from sim.devices.grbl import VirtualGrbl
from sim.devices.line import SerialLine

__all__ = ["SerialLine", "VirtualBalance", "VirtualGrbl"]
