"""How a run is cut short, and where: a signal at a write of its journal or at an instant, a cable at a byte.

`arm` is for a process that is to be struck: it changes what the run is made of, for good.
"""

import itertools
import os
import random
import signal
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import rig.bench.virtual as benches
import rig.session.session as sessions
from rig.clock import Clock
from rig.data.folder import RunFolder
from rig.data.journal import LineFile
from rig.transport.wire import HostLine, LoopbackTransport

SIGNALS = ("KILL", "TERM", "HUP")
JOURNAL = RunFolder(Path()).events.name
STAGES = ("before the write", "half written", "before the flush", "on disk")
CABLES = ("stage, port gone", "stage, silent", "force, port gone", "force, silent")


class Strike(Protocol):
    """One way to cut a run short."""

    @property
    def kind(self) -> str:
        """What it hits."""

    @property
    def how(self) -> str:
        """What it is."""

    def arm(self) -> None:
        """Have this process struck there."""


@dataclass(frozen=True)
class Kill:
    """A signal, at a write of the journal or at an instant of the bench's clock (s)."""

    how: str
    write: int | None = None
    stage: str = STAGES[0]
    t_s: float | None = None

    @property
    def kind(self) -> str:
        return "motion" if self.write is None else f"journal, {self.stage}"

    def arm(self) -> None:
        if self.t_s is None:
            self._arm_journal()
        else:
            self._arm_clock(self.t_s)

    def _strike(self) -> None:
        """KILL: no handler, no buffer flushed, nothing closed."""
        os.kill(os.getpid(), getattr(signal, f"SIG{self.how}"))

    def _arm_journal(self) -> None:
        append, numbers = LineFile.append, itertools.count()

        def struck(file: LineFile, line: bytes, *, sync: bool = False) -> None:
            if file.path.name != JOURNAL or next(numbers) != self.write:
                append(file, line, sync=sync)
                return
            written = {STAGES[0]: 0, STAGES[1]: len(line) // 2, STAGES[2]: len(line)}.get(self.stage)
            if written is None:
                append(file, line, sync=sync)
                self._strike()
                return
            append(file, line[:written])
            self._strike()
            append(file, line[written:], sync=sync)

        LineFile.append = struck  # type: ignore[method-assign, assignment]

    def _arm_clock(self, t_s: float) -> None:
        make = benches.virtual_bench

        def struck(*arguments: Any) -> Any:
            bench = make(*arguments)
            bench.clock.call_at(bench.clock.monotonic_s() + t_s, self._strike)
            return bench

        sessions.virtual_bench = struck  # type: ignore[attr-defined, assignment]


@dataclass(frozen=True)
class CableCut:
    """A cable that is pulled after so many bytes, in the middle of whatever they are."""

    how: str
    byte: int

    @property
    def kind(self) -> str:
        return "cable"

    def arm(self) -> None:
        port, way = self.how.split(", ")

        def made(line: HostLine, clock: Clock, name: str) -> LoopbackTransport:
            if name != port:
                return LoopbackTransport(line, clock, name)
            return CutWire(line, clock, name, left=self.byte, silent=way == "silent")

        benches.LoopbackTransport = made  # type: ignore[attr-defined, assignment]


class CutWire(LoopbackTransport):
    """A wire for so many bytes, both ways; then its port is gone, or nothing is heard any more."""

    def __init__(self, line: HostLine, clock: Clock, name: str, *, left: int, silent: bool) -> None:
        super().__init__(line, clock, name)
        self._left, self._silent = left, silent

    def write(self, data: bytes) -> None:
        if self._left or not self._silent:
            super().write(data[: self._left])
            self._pass(len(data))

    def read(self, timeout_s: float) -> bytes:
        if self._left or not self._silent:
            data = super().read(timeout_s)[: self._left]
            self._pass(len(data))
            return data
        self._clock.wait_until(lambda: False, self._clock.monotonic_s() + timeout_s)
        return b""

    def _pass(self, number: int) -> None:
        self._left = max(self._left - number, 0)
        if not (self._left or self._silent):
            self.close()


def kills(number: int, chance: random.Random, writes: int, duration_s: float) -> list[Kill]:
    """Half on writes, half on instants, one in each equal part of the run; as many of each signal, shuffled."""
    half = number // 2
    at_writes = _spread(half, chance, writes)
    at_times = _spread(number - half, chance, duration_s)
    signals = (SIGNALS * number)[:number]
    shuffled = iter(chance.sample(signals, number))
    found = [Kill(next(shuffled), int(write), STAGES[n % len(STAGES)]) for n, write in enumerate(at_writes)]
    return found + [Kill(next(shuffled), t_s=t_s) for t_s in at_times]


def cuts(number: int, chance: random.Random, wire_bytes: Callable[[str], int]) -> list[CableCut]:
    """As many of each cable, spread over the bytes that go over it in a run."""
    found = []
    for first, how in enumerate(CABLES[:number]):
        so_many = len(range(first, number, len(CABLES)))
        found += [CableCut(how, int(byte)) for byte in _spread(so_many, chance, wire_bytes(how.split(", ")[0]))]
    return found


def _spread(number: int, chance: random.Random, over: float) -> list[float]:
    """So many places, one at random in each equal part."""
    return [(n + chance.random()) * over / number for n in range(number)]
