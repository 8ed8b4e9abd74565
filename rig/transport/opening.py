"""A port by its name."""

import os

from rig.transport import tcp
from rig.transport.base import Transport, TransportError
from rig.transport.port_settings import EIGHT_N_ONE
from rig.transport.serial_port import SerialTransport


def open_port(
    port: str,
    baud: int,
    *,
    name: str | None = None,
    character: str = EIGHT_N_ONE,
    dtr: bool = True,
    owned: bool = True,
) -> Transport:
    """Open `tcp://HOST:PORT`, a serial device or a pyserial URL.

    Raises TransportError; NotOwnedError where somebody has the port, unless owned is False, as for a stop alone.
    """
    if port.startswith(tcp.SCHEME):
        return tcp.TcpTransport(port, name=name, owned=owned)
    return SerialTransport(port, baud, name=name, character=character, dtr=dtr, owned=owned)


def refuse_missing(port: str) -> None:
    """Raises TransportError for a device that is not there; opens nothing, and asks nothing of a URL."""
    if os.name == "posix" and "://" not in port and not os.path.exists(port):
        raise TransportError("there is no port {port}", code="no_port", port=port)
