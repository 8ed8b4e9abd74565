"""A port by its name."""

from rig.transport import tcp
from rig.transport.base import Transport
from rig.transport.serial_port import SerialTransport


def open_port(port: str, baud: int, *, name: str | None = None) -> Transport:
    """Open `tcp://HOST:PORT`, a serial device or a pyserial URL. Raises TransportError."""
    if port.startswith(tcp.SCHEME):
        return tcp.TcpTransport(port, name=name)
    return SerialTransport(port, baud, name=name)
