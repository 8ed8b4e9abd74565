"""Every byte on the wire, with its time, into bytes.jsonl."""

import json
from typing import TextIO

from rig.transport.base import Transport
from rig.transport.clock import Clock


class LoggedTransport:
    """A transport that writes one JSON line for each chunk: t_s (monotonic), port, dir (tx or rx), hex."""

    def __init__(self, inner: Transport, clock: Clock, sink: TextIO) -> None:
        self.name = inner.name
        self._inner = inner
        self._clock = clock
        self._sink = sink
        port = json.dumps(inner.name)
        self._tx = f', "port": {port}, "dir": "tx", "hex": "'
        self._rx = f', "port": {port}, "dir": "rx", "hex": "'

    def write(self, data: bytes) -> None:
        # The bytes go first: a full disk must not stand before a stop.
        t_s = self._clock.monotonic_s()
        self._inner.write(data)
        self._log(t_s, self._tx, data)

    def read(self, timeout_s: float) -> bytes:
        data = self._inner.read(timeout_s)
        if data:
            self._log(self._clock.monotonic_s(), self._rx, data)
        return data

    def close(self) -> None:
        self._inner.close()

    def _log(self, t_s: float, middle: str, data: bytes) -> None:
        self._sink.write(f'{{"t_s": {t_s:.6f}{middle}{data.hex()}"}}\n')
