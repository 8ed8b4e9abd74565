"""Bytes in and out: serial port or in-process loopback, with a log of the wire, and Modbus frames over them."""

from rig.transport.base import Transport, TransportError
from rig.transport.byte_log import LoggedTransport
from rig.transport.lines import LineReader
from rig.transport.loopback import LoopbackTransport
from rig.transport.modbus import (
    Framing,
    ModbusError,
    ModbusGarbled,
    ModbusMaster,
    ModbusRefused,
    ModbusTimeout,
)
from rig.transport.serial_port import SerialTransport, port_owner

__all__ = [
    "Framing",
    "LineReader",
    "LoggedTransport",
    "LoopbackTransport",
    "ModbusError",
    "ModbusGarbled",
    "ModbusMaster",
    "ModbusRefused",
    "ModbusTimeout",
    "SerialTransport",
    "Transport",
    "TransportError",
    "port_owner",
]
