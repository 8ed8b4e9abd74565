"""What a port is, whatever it is called: the resolved addresses of a TCP port, the device number of a serial one."""

import ipaddress
import os
import re
import socket
import stat
import sys
from typing import Any
from urllib.parse import urlsplit

from rig.transport.base import TransportError

SCHEME = "tcp://"

Address = tuple[int, tuple[Any, ...]]
"""Family and socket address."""

_OVER_TCP = ("socket://", "rfc2217://")  # pyserial's own ways to a TCP port


def tcp_addresses(port: str) -> tuple[Address, ...]:
    """Resolve a TCP port, once for its lock and its connection.

    Parameters
    ----------
    port : str
        ``tcp://HOST:PORT``.

    Returns
    -------
    tuple of (int, tuple)
        Family and socket address of each address of the host, in the system's order.

    Raises
    ------
    TransportError
        If the port has another form, or its host has no address.
    """
    host, colon, number = port.removeprefix(SCHEME).rpartition(":")
    if not (port.startswith(SCHEME) and host and colon and number.isdigit() and 0 < int(number) < 65536):
        raise TransportError("{port!r} is no TCP port, expected tcp://HOST:PORT", code="no_address", port=port)
    try:
        found = socket.getaddrinfo(host.strip("[]"), int(number), type=socket.SOCK_STREAM)
    except (OSError, UnicodeError) as problem:
        raise TransportError(
            "cannot open {port}: {problem}", code="unknown_host", port=port, problem=str(problem)
        ) from problem
    return tuple(dict.fromkeys((int(family), address) for family, _, _, _, address in found))


def identities(port: str) -> tuple[str, ...]:
    """Return what a port is, in as many parts as it has.

    Two names of which one part is the same may reach the same device. All addresses of this machine are one, since a
    listener may be bound to all of them.

    Parameters
    ----------
    port : str
        ``tcp://HOST:PORT``, a serial device or a pyserial URL.

    Returns
    -------
    tuple of str
        Sorted, so that whoever locks them all does so in the same order as everybody else.

    Raises
    ------
    TransportError
        If the host of a TCP port has no address.
    """
    if port.startswith(_OVER_TCP):
        url = urlsplit(port)
        port = f"{SCHEME}[{url.hostname}]:{url.port}"
    if port.startswith(SCHEME):
        return tuple(sorted({_of_address(*address) for address in tcp_addresses(port)}))
    return (port if "://" in port else _of_device(port),)


def _of_address(family: int, address: tuple[Any, ...]) -> str:
    ip = ipaddress.ip_address(address[0])
    mapped = getattr(ip, "ipv4_mapped", None) or ip
    here = mapped.is_loopback or mapped.is_unspecified or _is_here(family, address)
    return f"tcp-{'this-machine' if here else mapped}-{address[1]}"


def _is_here(family: int, address: tuple[Any, ...]) -> bool:
    """Whether an address is one of this machine's own: the system would send from it to itself. Nothing is sent."""
    try:
        with socket.socket(family, socket.SOCK_DGRAM) as probe:
            probe.connect(address)
            return bool(probe.getsockname()[0] == address[0])
    except OSError:
        return False


def _of_device(path: str) -> str:
    if sys.platform == "win32":
        return re.sub(r"^\\\\\.\\", "", path).upper()
    real = os.path.realpath(path)
    if sys.platform == "darwin":  # a line has two devices there, for calling in and out
        real = real.replace("/dev/cu.", "/dev/tty.")
    try:
        found = os.stat(real)
    except OSError:
        return real
    if stat.S_ISCHR(found.st_mode):
        return f"device-{os.major(found.st_rdev)}-{os.minor(found.st_rdev)}"
    return f"file-{found.st_dev}-{found.st_ino}"
