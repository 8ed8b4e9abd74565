"""Bytes in and out: serial port or in-process loopback, with a log of the wire."""

from rig.transport.base import Transport, TransportError
from rig.transport.byte_log import LoggedTransport
from rig.transport.lines import LineReader
from rig.transport.loopback import LoopbackTransport
from rig.transport.serial_port import SerialTransport, port_owner

__all__ = [
    "LineReader",
    "LoggedTransport",
    "LoopbackTransport",
    "SerialTransport",
    "Transport",
    "TransportError",
    "port_owner",
]
