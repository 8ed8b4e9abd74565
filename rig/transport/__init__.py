"""Bytes in and out: serial port, TCP or in-process loopback, with a log of the wire.

Modbus frames over them are in `rig/transport/modbus.py`, for those who speak it.
"""

from rig.transport.base import Transport, TransportError
from rig.transport.byte_log import LoggedTransport
from rig.transport.lines import LineReader
from rig.transport.loopback import LoopbackTransport
from rig.transport.machine_lock import PortOwner
from rig.transport.opening import open_port, refuse_missing
from rig.transport.ownership import NotOwnedError, first_owner, port_owner
from rig.transport.serial_port import SerialTransport
from rig.transport.tcp import TcpTransport

__all__ = [
    "LineReader",
    "LoggedTransport",
    "LoopbackTransport",
    "NotOwnedError",
    "PortOwner",
    "SerialTransport",
    "TcpTransport",
    "Transport",
    "TransportError",
    "first_owner",
    "open_port",
    "port_owner",
    "refuse_missing",
]
