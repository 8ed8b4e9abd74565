"""Spikes of simulated afferents for a page, read from the port of `rig serve --afferents`."""

import asyncio
import re
from collections import deque
from collections.abc import Sequence
from contextlib import suppress

from rig.clock import Clock
from rig.errors import BadInputError
from rig.panel.stream import Outlet

SHOWN_S = 10.0
"""Past time that a page shows (s)."""
MOST_SPIKES = 3000
"""Number of spikes that are kept."""
MOST_AFFERENTS = 2000
EACH_S, AGAIN_S = 0.2, 1.0
"""Periods (s): publication, connection after a loss."""
_CHUNK = 1 << 16
_PORT = re.compile(r"tcp://127\.0\.0\.1:(\d{1,5})", re.ASCII)
_NAME = re.compile(r"[\w.-]{1,40}")


def port_number(text: str) -> int:
    """Return the number of the port that `rig serve` printed. Raises BadInputError."""
    match = _PORT.fullmatch(text)
    if match is None or not 0 < int(match[1]) <= 65535:
        raise BadInputError(
            "{option} {value!r}: must be the port of the spikes that rig serve printed, tcp://127.0.0.1:N",
            code="bad_value", option="--spikes", value=text,
        )  # fmt: skip
    return int(match[1])


class SpikeView:
    """Last spikes of simulated afferents; `follow` follows their port until it is cancelled."""

    def __init__(self, port: int, outlet: Outlet, clock: Clock) -> None:
        self._port, self._outlet, self._clock = port, outlet, clock
        self._afferents: tuple[str, ...] = ()
        self._spikes = deque[tuple[int, float]](maxlen=MOST_SPIKES)
        self._connected = False
        self._changed = True

    async def follow(self) -> None:
        """Read and publish until cancelled."""
        async with asyncio.TaskGroup() as loops:
            loops.create_task(self._follow())
            loops.create_task(self._publish())

    async def _follow(self) -> None:
        while True:
            with suppress(OSError):
                reader, writer = await asyncio.open_connection("127.0.0.1", self._port)
                try:
                    await self._read(reader)
                finally:
                    self._connected, self._changed = False, True
                    writer.close()
                    await writer.wait_closed()
            await asyncio.sleep(AGAIN_S)

    async def _read(self, reader: asyncio.StreamReader) -> None:
        rest = b""
        self._connected, self._changed = True, True
        while data := await reader.read(_CHUNK):
            *lines, rest = (rest + data).split(b"\n")
            rest = rest[-_CHUNK:]
            self.take([line.decode("utf-8", "replace") for line in lines])

    def take(self, lines: Sequence[str]) -> None:
        """Take lines of the port; others are left out."""
        for line in lines:
            if line.startswith("# "):
                names = line.partition(": ")[2].split()[:MOST_AFFERENTS]
                self._afferents = tuple(name for name in names if _NAME.fullmatch(name))
                self._spikes.clear()
                self._changed = True
                continue
            at_s, _, rest = line.partition(",")
            kind, _, name = rest.partition(",")
            if kind != "spike" or name not in self._afferents:
                continue
            with suppress(ValueError):
                self._spikes.append((self._afferents.index(name), float(at_s)))
                self._changed = True

    async def _publish(self) -> None:
        while True:
            self.publish()
            await asyncio.sleep(EACH_S)

    def publish(self) -> None:
        """Publish the last spikes, if there is something new; times are ages (s) at unix_s."""
        if not self._changed:
            return
        self._changed = False
        now_s = self._clock.monotonic_s()
        rows = [[number, round(now_s - at_s, 4)] for number, at_s in self._spikes if now_s - at_s < SHOWN_S]
        self._outlet.publish(
            "spikes",
            {
                "unix_s": self._clock.unix_s(),
                "connected": self._connected,
                "afferents": self._afferents,
                "rows": rows,
            },
        )
