"""Odd lines and frames for the parsers of all device drivers: one reader for each table of tests/contracts/bytes.

A "file" is one reply: how it travels, what the driver is doing, and the bytes. A kind of device is included by its
table, which the contract asks of every entry in the registry.
"""

import importlib
import math
import pkgutil
import random
import struct
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from rig.devices.base import ForceError, StageError
from rig.errors import RigError
from rig.transport import TransportError
from tests.contracts import force, stage
from tests.contracts.force import Connected, ForceBytes
from tests.contracts.stage import StageBench, StageBytes
from tests.fuzz import mutations as of
from tests.fuzz.readers import Reader

IN_SUITE = 1000
"""Odd replies of each kind of device."""
SEALED, PATCHED, RAW = range(3)
"""The reply in its frame; in a frame that is changed by three bytes; as it is."""
READ_S, MOST_READS = 2e-3, 100_000
"""What each read of the wire takes, so that no device answers in no time; and how many there may be."""
STOPPED = ("new", "rested", "slowing", "held")


class HangError(BaseException):
    """A driver that reads for ever, whatever the clock says."""


def tables() -> Iterator[ForceBytes | StageBytes]:
    """Yield the table of every device."""
    folder = Path(__file__).parents[1] / "contracts" / "bytes"
    for info in pkgutil.iter_modules([str(folder)]):
        for found in vars(importlib.import_module(f"tests.contracts.bytes.{info.name}")).values():
            if isinstance(found, ForceBytes | StageBytes):
                yield found


@dataclass
class Odd:
    """What becomes of the replies of a device."""

    said: Callable[[bytes, bytes], bytes]
    form: int = SEALED
    reply: bytes | None = None
    always: bool = False

    def __call__(self, frame: bytes, reply: bytes) -> bytes:
        if self.reply is None:
            return self.said(frame, reply)
        odd = self.reply
        if not self.always:
            self.reply = None
        if self.form == RAW:
            return odd
        patch = odd[-3:] if self.form == PATCHED else b""
        try:
            framed = self.said(frame, odd[: len(odd) - len(patch)])
        except (ValueError, OverflowError, struct.error):  # no reply that a frame could hold
            return odd
        return _patched(framed, patch) if len(patch) == 3 else framed


def _patched(frame: bytes, patch: bytes) -> bytes:
    how, place, byte = patch
    at = place % (len(frame) + 1)
    return frame[:at] + (bytes([byte]) if how % 3 else b"") + frame[at + (how % 3 != 1) :]


class Parser:
    """A driver that hears one odd reply after another, and is made anew when an error has ended its work."""

    def __init__(self, table: Any) -> None:
        self._odd = Odd(table.said)
        self.table = replace(table, said=self._odd)
        self._bench: Any = None

    @property
    def verbs(self) -> Sequence[Callable[[Any], object]]:
        raise NotImplementedError

    def read(self, path: Path) -> None:
        """Hear the reply in a file. Raises the device's own errors, and AssertionError if anything else happens."""
        how, verb, *reply = path.read_bytes().ljust(2, b"\0")
        self._odd.reply = None
        act = self.verbs[verb % len(self.verbs)]
        bench, self._bench = self._bench, None
        self._reads = 0
        if bench is None or not self._may_stay(bench, act):
            bench = self._new()
            self._bounded(bench)
        self._before(bench, act)
        begun_s = bench.clock.monotonic_s()
        self._odd.form, self._odd.always, self._odd.reply = how % 3, how % 2 == 1, bytes(reply)
        try:
            with self._only_own_errors():
                act(bench)
            self._bench = bench
        finally:
            took_s = bench.clock.monotonic_s() - begun_s
            assert took_s <= self.most_s, f"{took_s:.1f} s"
            self._check(bench)

    def _bounded(self, bench: Any) -> None:
        inner = bench.wire.read

        def read(*asked: Any) -> bytes:
            self._reads += 1
            if self._reads > MOST_READS:
                raise HangError
            bench.clock.wait_s(READ_S)
            return inner(*asked)

        bench.wire.read = read

    @contextmanager
    def _only_own_errors(self) -> Iterator[None]:
        try:
            yield
        except (self.own, TransportError):
            raise
        except RigError as error:
            raise AssertionError(f"{type(error).__name__} {error.code}: {error}") from error
        except HangError:
            raise AssertionError(f"more than {MOST_READS} reads") from None

    own: type[RigError]
    """Its errors, besides those of the wire."""
    most_s: float
    _reads = 0

    def _new(self) -> Any:
        raise NotImplementedError

    def _may_stay(self, bench: Any, act: object) -> bool:
        """Whether a driver that has heard odd replies may be asked this."""
        return True

    def _before(self, bench: Any, act: object) -> None:
        raise NotImplementedError

    def _check(self, bench: Any) -> None:
        raise NotImplementedError


class StageParser(Parser):
    """A stage: it does not begin to move, whatever it hears."""

    own, most_s = StageError, 2 * stage.GIVES_UP_S

    @property
    def verbs(self) -> Sequence[Callable[[StageBench], object]]:
        return (lambda b: b.stage.status(), lambda b: b.stage.look(), self._under_way, lambda b: b.stage.connect())

    def _new(self) -> StageBench:
        return StageBench(self.table, homed=True)

    def _under_way(self, bench: StageBench) -> None:
        next(self._looks, None)
        bench.stage.stop()

    def _may_stay(self, bench: StageBench, act: object) -> bool:
        """A position that it believed changes where it sends the next move to."""
        return bench.stage.homed and act != self._under_way

    def _before(self, bench: StageBench, act: object) -> None:
        bench.wire.forget()
        if act == self._under_way:
            self._looks = bench.under_way()
        self._moves, self._state = bench.wire.asked.count(self.table.trigger), bench.wire.state

    def _check(self, bench: StageBench) -> None:
        assert bench.wire.asked.count(self.table.trigger) == self._moves, "it moves"
        assert bench.wire.state in (self._state, *STOPPED), f"{self._state}, then {bench.wire.state}"


class ForceParser(Parser):
    """A force sensor: a finite force or an error, and it is not zeroed."""

    own, most_s = ForceError, 2 * force.GIVES_UP_S

    @property
    def verbs(self) -> Sequence[Callable[[Connected], object]]:
        return (self._read, lambda b: b.driver.identify(), lambda b: b.driver.connect())

    def _new(self) -> Connected:
        return Connected(self.table)

    def _read(self, bench: Connected) -> None:
        assert math.isfinite(bench.driver.read().force_n)

    def _before(self, bench: Connected, act: object) -> None:
        bench.wire.asked.clear()

    def _check(self, bench: Connected) -> None:
        assert self.table.zero not in bench.wire.asked, "it is zeroed"


def _replies(table: ForceBytes | StageBytes) -> list[bytes]:
    """Every reply of a table, the usual one to its main question first."""
    states = table.states.values() if isinstance(table, StageBytes) else ()
    said = [
        reply[0] if isinstance(reply, tuple) else reply for one in (table.usual, *states) for reply in one.values()
    ]
    if isinstance(table, ForceBytes):
        said += [row.reply for rows in (table.weights, table.refusals, table.garbled) for row in rows.values()]
    return list(dict.fromkeys([_usual(table), *said]))


def _usual(table: ForceBytes | StageBytes) -> bytes:
    found = table.usual[table.where if isinstance(table, StageBytes) else table.reading]
    return found[0] if isinstance(found, tuple) else found


def _mutated(rng: random.Random, examples: Sequence[bytes], replies: Sequence[bytes]) -> bytes:
    """Return a reply of the table, or noise, with mutations, in one of the ways."""
    some = rng.choice(replies) if rng.random() < 0.6 else examples[0][2:]
    form = rng.choice((SEALED, PATCHED, RAW)) + 3 * rng.randrange(2)
    if form % 3 == PATCHED and rng.random() < 0.7:
        return bytes([form, rng.randrange(4)]) + some + rng.randbytes(3)
    odd = of.of_bytes(rng, [some, *replies]) if rng.random() < 0.8 else rng.randbytes(rng.randrange(1, 60)) + b"\r\n"
    return bytes([form, rng.randrange(4)]) + odd[:4000]


def _reader(table: ForceBytes | StageBytes, in_suite: int) -> Reader:
    parser: Parser = StageParser(table) if isinstance(table, StageBytes) else ForceParser(table)
    example = bytes([SEALED, 0]) + _usual(table)
    return Reader(
        "reply", partial(_mutated, replies=_replies(table)), lambda _: [example], parser.read, in_suite=in_suite
    )


_TABLES = list(tables())
_OF_A_KIND = Counter(table.kind for table in _TABLES)
DEVICES = {table.name: _reader(table, math.ceil(IN_SUITE / _OF_A_KIND[table.kind])) for table in _TABLES}
"""The parser of every table, by its name."""
KINDS = set(_OF_A_KIND)
