"""How many Net F/T records are lost at 7 kHz beside busy cores, and how old a sample is when the program has it.

    .venv/bin/python -m studies.speed.net_ft_records    # studies/results/devices/net_ft.csv

Another process sends records over UDP on this machine, with the time of each in its torques. The driver reads as in a
press, every 10 ms. Age: from the sending of the record to the reading. Wait: from the request to the reading.
"""

import argparse
import contextlib
import multiprocessing
import socket
import struct
import time
from collections.abc import Sequence
from multiprocessing.connection import Connection

import numpy as np

from rig.clock import WallClock
from rig.devices.base import ForceError
from rig.devices.net_ft import GET_PAGE, MAX_AGE_S, NetFtForce, NetFtSettings
from rig.settings import ForceSettings
from rig.transport import UdpTransport
from studies.registry import show

READ_S = 0.01
HEAD = (
    "records/s", "busy processes", "s", "records", "lost", "repeated", "late", "readings", "age, ms", "wait, ms",
    "over 20 ms", "errors",
)  # fmt: skip
_PAGE = (
    b"HTTP/1.0 200 OK\r\n\r\n<netft><prodname>sender</prodname><cfgcpf>1000000</cfgcpf><cfgcpt>1000000</cfgcpt>"
    b"<scfgfu>N</scfgfu><scfgtu>Nm</scfgtu></netft>"
)


class _Page:
    """The sensor's page, without a network."""

    name, _left = "page", b""

    def write(self, data: bytes) -> None:
        self._left = _PAGE if data == GET_PAGE else b""

    def read(self, timeout_s: float) -> bytes:
        data, self._left = self._left, b""
        return data

    def close(self) -> None:
        """There is nothing to close."""


def send(rate_hz: int, tell: "Connection[int, int]") -> None:
    """Send records to whoever asks, until the other end of the pipe sends something; then send their number."""
    wire = socket.socket(type=socket.SOCK_DGRAM)
    wire.bind(("127.0.0.1", 0))
    tell.send(wire.getsockname()[1])
    _, peer = wire.recvfrom(64)
    number, begin_s = 0, time.monotonic()
    while not tell.poll():
        for _ in range(64):
            due_s = begin_s + number / rate_hz
            while (left_s := due_s - time.monotonic()) > 0:
                time.sleep(left_s)
            number += 1
            now_us = time.monotonic_ns() // 1000
            data = struct.pack(">III6i", number, number, 0, 0, 0, 0, now_us // 10**6, now_us % 10**6, 0)
            with contextlib.suppress(ConnectionRefusedError):
                wire.sendto(data, peer)
    tell.send(number)


def burn() -> None:
    """Keep a core busy."""
    while True:
        sum(range(100_000))


def measured(rate_hz: int, busy: int, seconds: float) -> list[str]:
    """Return a row of the table."""
    near, far = multiprocessing.Pipe()
    others = [multiprocessing.Process(target=burn, daemon=True) for _ in range(busy)]
    sender = multiprocessing.Process(target=send, args=(rate_hz, far), daemon=True)
    for one in (*others, sender):
        one.start()
    ages_s, waits_s, errors, last = list[float](), list[float](), 0, {"packets_lost": 0.0}
    wire, instrument = UdpTransport(f"udp://127.0.0.1:{near.recv()}"), ForceSettings()
    force = NetFtForce(
        wire,
        _Page,
        WallClock(),
        NetFtSettings(),
        sample_period_s=instrument.sample_period_s,
        latency_s=instrument.latency_s,
        resolution_gwt=instrument.resolution_gwt,
        scale=1.0,
    )
    try:
        force.connect()
        until_s = time.monotonic() + seconds
        while (asked_s := time.monotonic()) < until_s:
            try:
                last = dict(force.read().also)
            except ForceError:
                errors += 1
                continue
            now_s = time.monotonic()
            waits_s.append(now_s - asked_s)
            ages_s.append(now_s - round(last["tx_nm"] * 1e6) - round(last["ty_nm"] * 1e6) / 1e6)
            time.sleep(READ_S)
        near.send(0)
        sent = near.recv()
    finally:
        force.close()
        for one in (*others, sender):
            one.terminate()
            one.join()
    over = sum(max(pair) > MAX_AGE_S for pair in zip(ages_s, waits_s, strict=True))
    counts = [f"{last[f'packets_{word}']:.0f}" for word in ("lost", "repeated", "late")]
    numbers = [str(rate_hz), str(busy), f"{seconds:g}", str(sent), *counts, str(len(ages_s))]
    return [*numbers, _three(ages_s), _three(waits_s), str(over), str(errors)]


def _three(seconds: Sequence[float]) -> str:
    """Return median / p99 / worst in ms."""
    median, p99 = np.percentile(seconds, (50, 99))
    return f"{1e3 * median:.2f} / {1e3 * p99:.2f} / {1e3 * max(seconds):.2f}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=60.0)
    asked = parser.parse_args()
    show(HEAD, (measured(rate_hz, busy, asked.seconds) for rate_hz, busy in ((1000, 2), (7000, 0), (7000, 2))))


if __name__ == "__main__":
    main()
