"""Bytes in and out: serial port, TCP or in-process loopback, with a log of the wire.

Modbus frames over them are in `rig/transport/modbus.py`, for those who speak it.
"""

from rig.transport.ownership import NotOwnedError, PortOwner, first_owner, port_owner
from rig.transport.ports import SerialTransport, TcpTransport, open_port, refuse_missing
from rig.transport.wire import LineReader, LoggedTransport, LoopbackTransport, Transport, TransportError

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
