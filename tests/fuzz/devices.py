"""Odd lines and frames for the parsers of all device drivers, by the tables of tests/contracts/bytes.

A kind of device is included by its table, which the contract asks of every entry in the registry.
"""

import math
import struct
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from hypothesis import strategies as st

from rig.devices.base import ForceError, StageError
from rig.errors import RigError
from rig.transport import TransportError
from tests.contracts import force, stage
from tests.contracts.force import Connected, ForceBytes
from tests.contracts.stage import StageBench, StageBytes
from tests.contracts.tables import tables
from tests.fuzz.hostile import hostile

SEALED, PATCHED, RAW = range(3)
"""The reply in its frame; in a frame that is changed by three bytes; as it is."""
READ_S, MOST_READS = 2e-3, 100_000
"""What each read of the wire takes, so that no device answers in no time; and how many there may be."""


class Reply(NamedTuple):
    """A reply: how it travels, whether again and again, what the driver does (by its number), and the bytes."""

    form: int
    always: bool
    verb: int
    content: bytes


STOPPED = ("new", "rested", "slowing", "held")


class HangError(BaseException):
    """A driver that reads for ever, whatever the clock says."""


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

    def hear(self, replies: Sequence[Reply]) -> None:
        """Hear replies, one after another. Raises AssertionError if anything but the device's own errors happens."""
        self._bench = None
        for reply in replies:
            with suppress(self.own, TransportError):
                self._hear(reply)

    def _hear(self, reply: Reply) -> None:
        self._odd.reply = None
        act = self.verbs[reply.verb % len(self.verbs)]
        bench, self._bench = self._bench, None
        self._reads = 0
        if bench is None or not self._may_stay(bench, act):
            bench = self._new()
            self._bounded(bench)
        self._before(bench, act)
        begun_s = bench.clock.monotonic_s()
        self._odd.form, self._odd.always, self._odd.reply = reply.form, reply.always, reply.content
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


def conversations(table: ForceBytes | StageBytes) -> st.SearchStrategy[list[Reply]]:
    """Return a strategy for some replies of a table, changed, or noise, each with what the driver does."""
    noise = st.binary(min_size=1, max_size=60).map(lambda some: some + b"\r\n")
    odd = st.sampled_from(_replies(table)) | hostile(_replies(table)).map(lambda some: some[:4000]) | noise
    patched = st.builds(bytes.__add__, st.sampled_from(_replies(table)), st.binary(min_size=3, max_size=3))
    one = st.builds(Reply, st.sampled_from((SEALED, PATCHED, RAW)), st.booleans(), st.integers(0, 3), odd | patched)
    return st.lists(one, min_size=1, max_size=5)


def parser_of(table: ForceBytes | StageBytes) -> Parser:
    """Return the parser of a table."""
    return StageParser(table) if isinstance(table, StageBytes) else ForceParser(table)


TABLES = {table.name: table for table in tables(ForceBytes) + tables(StageBytes)}
KINDS = {table.kind for table in TABLES.values()}
