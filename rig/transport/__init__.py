"""Transports of bytes: serial port, TCP, UDP or in-process loopback, with a byte log.

Modbus frames are in `rig/transport/modbus.py`, which only Modbus drivers import.
"""

from rig.transport.ownership import NotOwnedError, PortOwner, first_owner, port_owner
from rig.transport.ports import SerialTransport, TcpTransport, UdpTransport, open_port, refuse_missing
from rig.transport.wire import (
    LineReader,
    LoggedTransport,
    LoopbackTransport,
    TimeLimitedTransport,
    Transport,
    TransportError,
    in_turn,
)

__all__ = [
    "LineReader",
    "LoggedTransport",
    "LoopbackTransport",
    "NotOwnedError",
    "PortOwner",
    "SerialTransport",
    "TcpTransport",
    "TimeLimitedTransport",
    "Transport",
    "TransportError",
    "UdpTransport",
    "first_owner",
    "in_turn",
    "open_port",
    "port_owner",
    "refuse_missing",
]
