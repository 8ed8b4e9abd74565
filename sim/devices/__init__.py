"""Virtual devices: they answer the same bytes as the real ones."""

from sim.devices.balance import VirtualBalance
from sim.devices.grbl.board import VirtualGrbl
from sim.devices.laumas import VirtualLaumas
from sim.devices.leadshine import VirtualDrive
from sim.devices.line import SerialLine
from sim.devices.modbus import ModbusBus

__all__ = ["ModbusBus", "SerialLine", "VirtualBalance", "VirtualDrive", "VirtualGrbl", "VirtualLaumas"]
