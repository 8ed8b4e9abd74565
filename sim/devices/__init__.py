"""Virtual devices: they answer the same bytes as the real ones.

Each takes the scheduler, its serial line (or a place on a ModbusBus) and one record of what is set on the real
instrument; a force sensor also takes the Load that stands on it. A GRBL board is a folder of its own.
"""

from sim.devices.balance import BalanceMenu, VirtualBalance
from sim.devices.cell import Load
from sim.devices.grbl.board import VirtualGrbl
from sim.devices.grbl.core import Mechanics
from sim.devices.laumas import TransmitterFirmware, TransmitterMenu, VirtualLaumas
from sim.devices.leadshine import DriveParameters, VirtualDrive
from sim.devices.line import SerialLine
from sim.devices.modbus import ModbusBus

__all__ = [
    "BalanceMenu",
    "DriveParameters",
    "Load",
    "Mechanics",
    "ModbusBus",
    "SerialLine",
    "TransmitterFirmware",
    "TransmitterMenu",
    "VirtualBalance",
    "VirtualDrive",
    "VirtualGrbl",
    "VirtualLaumas",
]
