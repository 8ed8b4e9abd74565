"""Virtual devices: they answer the same bytes as the real ones.

Each takes the scheduler, its serial line (or a place on a ModbusBus) and one record of what is set on the real
instrument; a force sensor also takes the Load that stands on it. A GRBL board is a folder of its own. Names are
imported when first used: a bench of a board and a balance waits for nothing that speaks Modbus.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sim.devices.grbl.board import VirtualGrbl
    from sim.devices.grbl.core import Mechanics
    from sim.devices.laumas import TransmitterFirmware, TransmitterMenu, VirtualLaumas
    from sim.devices.leadshine import DriveParameters, VirtualDrive
    from sim.devices.line import Load, SerialLine
    from sim.devices.modbus import ModbusBus
    from sim.devices.mtsics import BalanceMenu, VirtualBalance

_HOMES = {
    "BalanceMenu": "mtsics",
    "DriveParameters": "leadshine",
    "Load": "line",
    "Mechanics": "grbl.core",
    "ModbusBus": "modbus",
    "SerialLine": "line",
    "TransmitterFirmware": "laumas",
    "TransmitterMenu": "laumas",
    "VirtualBalance": "mtsics",
    "VirtualDrive": "leadshine",
    "VirtualGrbl": "grbl.board",
    "VirtualLaumas": "laumas",
}

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


def __getattr__(name: str) -> Any:
    """Import what is asked for."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
