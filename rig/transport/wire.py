"""Every byte on the wire, with its time, into bytes.jsonl."""

import json
from pathlib import Path
from types import TracebackType
from typing import Protocol

from rig.line_file import LineFile
from rig.transport.base import Transport
from rig.transport.clock import Clock


class Sink(Protocol):
    """Where lines go."""

    def write(self, text: str, /) -> object:
        """Take one whole line."""


class ByteLog:
    """A file of whole lines. One that cannot be written ends it and is its `problem`: it stands before no stop."""

    def __init__(self, path: Path) -> None:
        """One that is there already is added to. Raises OSError."""
        self.file = LineFile(path)
        self.problem: OSError | None = None

    def write(self, text: str, /) -> None:
        if self.problem is not None and self.file.lost is None:  # a lost file can still be read back
            return
        try:
            self.file.append(text.encode("ascii"))
        except OSError as error:
            self.problem = error

    def check(self) -> None:
        """Notice where the file is no longer the one at its path: that is its `problem`, too."""
        if self.problem is None:
            try:
                self.file.check()
            except OSError as error:
                self.problem = error

    def __enter__(self) -> "ByteLog":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.file.close()


class LoggedTransport:
    """A transport that writes one JSON line for each chunk: t_s (monotonic), port, dir (tx or rx), hex."""

    def __init__(self, inner: Transport, clock: Clock, sink: Sink) -> None:
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
