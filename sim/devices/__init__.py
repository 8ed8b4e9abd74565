"""Virtual devices that answer with the same bytes as the real ones.

Each takes the scheduler, its serial line (or an id on a ModbusBus) and a record of the real instrument's own
settings;
a force sensor also takes its Load. Names are imported on first use, so that a bench without Modbus never loads it.
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
    """Import a name on first use."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
