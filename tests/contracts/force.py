"""The contract of a force sensor: what every driver does with what its device says, whatever the device is.

A device is one table of bytes in `tests/contracts/bytes/`, quoted from its documentation, and nothing else.
"""

import heapq
import itertools
import math
import pickle
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import pytest

from rig.devices.base import ForceError, ForceReading, ForceSensor, ForceTimeout
from rig.devices.registry import ForceKind, KnownBench, find
from rig.transport import TransportError
from rig.units import GWT_N
from sim.devices.clock import VirtualClock
from tests.error_codes import has_code, raises

PORT, BEGUN_S = "wire", 1000.0
SILENCE = UNASKED = b""
GIVES_UP_S = 2.0
"""After so long without a reply every driver says so."""

Frame = Callable[[bytes], bytes]


def as_it_is(data: bytes) -> bytes:
    """The bytes themselves."""
    return data


@dataclass(frozen=True)
class Weight:
    """A reply that is a weight."""

    reply: bytes
    grams: float
    stable: bool


@dataclass(frozen=True)
class NoWeight:
    """A reply that is none, and the error that it is; mangled: what becomes of its frame on the wire."""

    reply: bytes
    kind: type[ForceError] = ForceError
    code: str = "garbled"
    mangled: Frame = as_it_is


def without_line_end(line: bytes) -> Mapping[str, NoWeight]:
    """A line that ends otherwise than with LF: bytes arrive, and the cable is no reason."""
    ends = {
        "CR alone": line + b"\r",
        "STX and ETX": b"\x02" + line + b"\x03",
        "ETX and a checksum": b"\x02" + line + b"\x034F",
        "no end": line,
        "a beginning": line[:5],
    }
    return {name: NoWeight(data, ForceTimeout, "no_line_end") for name, data in ends.items()}


@dataclass(frozen=True)
class Zeroing:
    """Replies while the sensor is zeroed, each question's one after the other; without a kind it is zeroed.

    told: how often it is commanded to.
    """

    replies: Mapping[bytes, Sequence[bytes]]
    kind: type[ForceError] | None = None
    code: str = ""
    told: int = 1


@dataclass(frozen=True, kw_only=True)
class ForceBytes:
    """What a device is asked, and what its replies mean.

    name: of the table. kind: as in the catalogue; table: of [force]. usual: the good reply to every question.
    on_connect, on_identify: the questions of these; again: what else is asked where a reply is missing.
    reading: the question for a weight. zero: the command.
    not_now: replies upon which it is asked again, and the error if it says nothing else.
    lacks: what this device cannot say, and why. heard: the question in a frame; said: the frame of a reply to one.
    stream_s: a device that replies to no question sends its reading, that of the question UNASKED, so often.
    framed: the frame of a question. alike: a reply without what each device has of its own, such as a serial number.
    not_on_twin: questions, and names of weights and refusals, that cannot be tried on the twin, and why.
    max_age_s: what the entry declares with this table.
    """

    name: str
    kind: str
    source: str
    table: Mapping[str, Any] = field(default_factory=dict)
    identity: str
    usual: Mapping[bytes, bytes]
    on_connect: Sequence[bytes]
    on_identify: Sequence[bytes]
    again: Sequence[bytes] = ()
    max_age_s: float
    reading: bytes
    zero: bytes
    weights: Mapping[str, Weight]
    refusals: Mapping[str, NoWeight]
    garbled: Mapping[str, NoWeight]
    zeroing: Mapping[str, Zeroing]
    not_now: Mapping[str, NoWeight] = field(default_factory=dict)
    lacks: Mapping[str, str] = field(default_factory=dict)
    heard: Frame = as_it_is
    framed: Frame = as_it_is
    said: Callable[[bytes, bytes], bytes] = lambda question, reply: reply
    alike: Frame = as_it_is
    not_on_twin: Mapping[bytes | str, str] = field(default_factory=dict)
    stream_s: float = math.inf

    def questions(self, number: int) -> list[bytes]:
        """What is sent for so many readings."""
        return [] if self.reading == UNASKED else [self.reading] * number


class FarEnd:
    """The wire, and a device that replies by its table; a question that is not in the table fails the test."""

    name = PORT

    def __init__(self, device: ForceBytes, clock: VirtualClock) -> None:
        self.device, self.clock, self.closed = device, clock, False
        self.replies = {question: [reply] for question, reply in device.usual.items()}
        self.mangled, self.after_s, self.silent, self.cut = as_it_is, 0.0, False, ""
        self.asked: list[bytes] = []
        self.frames: list[bytes] = []
        self._coming: list[tuple[float, int, bytes]] = []
        self._next_s = clock.monotonic_s() + device.stream_s
        self._number = itertools.count()

    def write(self, data: bytes) -> None:
        self._refuse_cut("write")
        question = self.device.heard(data)
        assert question in self.replies, f"{question!r} is no question to {self.device.name}"
        self.asked.append(question)
        self.frames.append(data)
        self._reply(question, data)

    def read(self, timeout_s: float) -> bytes:
        self._refuse_cut("read")
        now_s = self.clock.monotonic_s()
        while self._next_s <= now_s + timeout_s and not (self._coming and self._coming[0][0] <= self._next_s):
            self.clock.wait_s(max(self._next_s - now_s, 0.0))
            self._next_s += self.device.stream_s
            self._reply(UNASKED, UNASKED, 0.0)
            timeout_s -= self.clock.monotonic_s() - now_s
            now_s = self.clock.monotonic_s()
        if self._coming and self._coming[0][0] <= now_s + timeout_s:
            due_s, _, data = heapq.heappop(self._coming)
            self.clock.wait_s(due_s - now_s)
            return data
        self.clock.wait_s(timeout_s)
        return b""

    def close(self) -> None:
        self.closed = True

    def send(self, data: bytes, after_s: float) -> None:
        """Have bytes come in."""
        heapq.heappush(self._coming, (self.clock.monotonic_s() + after_s, next(self._number), data))

    def _reply(self, question: bytes, frame: bytes, after_s: float | None = None) -> None:
        replies = self.replies[question]
        reply = replies.pop(0) if len(replies) > 1 else replies[0]
        if reply and not self.silent:
            self.send(self.mangled(self.device.said(frame, reply)), self.after_s if after_s is None else after_s)

    def _refuse_cut(self, way: str) -> None:
        if way in self.cut:
            raise TransportError(f"{PORT} is cut", "cut")


class Connected:
    """A driver of the catalogue that has just connected to its device, at a late hour of the clock.

    scale: as measured; where nothing was measured it is 1.
    """

    def __init__(self, device: ForceBytes, *, scale: float | None = None) -> None:
        self.device = device
        self.clock = VirtualClock(1.7e9, BEGUN_S)
        self.wire = FarEnd(device, self.clock)
        measured = {"value": scale, "sd": 0.01, "date": "2026-01-01", "expires": "2027-01-01"}
        calibration = {} if scale is None else {"force_scale": measured}
        bench = KnownBench.model_validate(
            {"force": {"kind": device.kind, **device.table}, "calibration": calibration}
        )
        kind = find(ForceKind, device.kind)
        self.max_age_s = kind.max_age_s(bench.force)
        self.driver: ForceSensor = kind.driver(lambda port: self.wire, self.clock, bench)
        self.driver.connect()
        self.wire.asked.clear()
        self.begun_s = self.clock.monotonic_s()

    def hears(self, reply: bytes, mangled: Frame = as_it_is) -> None:
        """From now on the question for a weight has this reply."""
        self.wire.replies[self.device.reading], self.wire.mangled = [reply], mangled

    def hears_as_usual(self) -> None:
        self.hears(self.device.usual[self.device.reading])

    def answers(self, replies: Mapping[bytes, Sequence[bytes]]) -> None:
        """From now on these questions have these replies, one after the other; the last one stays."""
        self.wire.replies.update({question: list(those) for question, those in replies.items()})

    def lasts_s(self, ask: Callable[[], object], kind: type[ForceError], code: str) -> float:
        """How long it takes until this error comes, which survives a pickle."""
        begun_s = self.clock.monotonic_s()
        with raises(kind, code, port=PORT) as caught:
            ask()
        assert type(caught.value) is kind, repr(caught.value)
        again = pickle.loads(pickle.dumps(caught.value))
        assert (type(again), str(again), vars(again)) == (kind, str(caught.value), vars(caught.value))
        return self.clock.monotonic_s() - begun_s


class ForceContract:
    """What is asked of every sensor; a subclass says of which devices."""

    devices: ClassVar[Sequence[ForceBytes]] = ()
    TABLES: ClassVar[Mapping[str, str]] = {
        "weight": "weights", "refusal": "refusals", "garbled": "garbled", "zeroing": "zeroing", "not_now": "not_now",
    }  # fmt: skip

    def pytest_generate_tests(self, metafunc: pytest.Metafunc) -> None:
        """Every test for every device, and for every row of the table that it is about."""
        rows = [name for name in self.TABLES if name in metafunc.fixturenames]
        if rows:
            cases = [
                pytest.param(device, case, id=f"{device.name}-{name}")
                for device in self.devices
                for name, case in getattr(device, self.TABLES[rows[0]]).items()
            ]
            metafunc.parametrize(("device", rows[0]), cases)
        elif "device" in metafunc.fixturenames:
            metafunc.parametrize("device", self.devices, ids=lambda device: device.name)

    # --- who it is ---

    def test_a_silent_port_is_no_device(self, device: ForceBytes) -> None:
        """One that is switched on later is found."""
        there = Connected(device)
        there.wire.silent = True
        for ask in (there.driver.connect, there.driver.identify):
            assert 0.1 < there.lasts_s(ask, ForceTimeout, "no_device") < GIVES_UP_S
        there.wire.silent = False
        assert there.driver.connect() == device.identity

    def test_connecting_identifies_the_sensor(self, device: ForceBytes) -> None:
        there = Connected(device)
        assert there.driver.connect() == device.identity
        assert there.wire.asked == list(device.on_connect)

    def test_identifying_a_sensor_changes_nothing(self, device: ForceBytes) -> None:
        there = Connected(device)
        assert there.driver.identify() == device.identity
        assert there.wire.asked == list(device.on_identify)
        assert there.driver.read().force_n == pytest.approx(_usual_n(device))

    @pytest.mark.parametrize(("sample_period_s", "resolution_gwt"), [(0.04, 0.02), (0.08, 0.5)])
    @pytest.mark.parametrize("scale", [None, 1.25])
    def test_sample_period_and_resolution_are_those_of_the_configuration(
        self, device: ForceBytes, sample_period_s: float, resolution_gwt: float, scale: float | None
    ) -> None:
        """By these the rig waits for a new sample, and tells a touch from noise."""
        table = {**device.table, "sample_period_s": sample_period_s, "resolution_gwt": resolution_gwt}
        driver = Connected(replace(device, table=table), scale=scale).driver
        assert driver.sample_period_s == sample_period_s
        assert driver.resolution_gwt == pytest.approx((scale or 1.0) * resolution_gwt)

    # --- readings ---

    @pytest.mark.parametrize("scale", [None, 1.25])
    def test_a_reading_in_newton_with_its_time(self, device: ForceBytes, weight: Weight, scale: float | None) -> None:
        there = Connected(device, scale=scale)
        there.hears(weight.reply)
        there.clock.wait_s(3.0)
        there.wire.after_s = 0.02
        found = there.driver.read()
        force_n = pytest.approx((scale or 1.0) * weight.grams * GWT_N, rel=1e-12, abs=1e-15)
        assert found == ForceReading(force_n, weight.stable, pytest.approx(there.clock.monotonic_s()))
        assert 3.0 <= found.t_s - there.begun_s < 3.1
        assert there.wire.asked == device.questions(1)

    def test_what_it_cannot_weigh_is_an_error_and_it_stays_in_step(
        self, device: ForceBytes, refusal: NoWeight
    ) -> None:
        there = Connected(device)
        there.hears(refusal.reply)
        assert there.lasts_s(there.driver.read, refusal.kind, refusal.code) < GIVES_UP_S
        there.hears_as_usual()
        assert there.driver.read().force_n == pytest.approx(_usual_n(device))
        assert there.wire.asked == device.questions(2)

    def test_a_garbled_reply_is_an_error_and_the_next_one_is_believed(
        self, device: ForceBytes, garbled: NoWeight
    ) -> None:
        there = Connected(device)
        there.hears(garbled.reply, garbled.mangled)
        assert there.lasts_s(there.driver.read, garbled.kind, garbled.code) < GIVES_UP_S
        there.hears_as_usual()
        assert there.driver.read().force_n == pytest.approx(_usual_n(device))

    @pytest.mark.parametrize("times", [1, 4])
    def test_a_device_that_is_busy_is_asked_again_and_only_its_weight_counts(
        self, device: ForceBytes, not_now: NoWeight, times: int
    ) -> None:
        there = Connected(device)
        there.answers({device.reading: [not_now.reply] * times + [device.usual[device.reading]]})
        assert there.driver.read().force_n == pytest.approx(_usual_n(device))
        assert there.wire.asked == device.questions(times + 1)
        assert there.clock.monotonic_s() - there.begun_s < there.max_age_s

    def test_a_device_that_stays_busy_is_an_error_within_the_sample_age_and_it_stays_in_step(
        self, device: ForceBytes, not_now: NoWeight
    ) -> None:
        there = Connected(device)
        there.hears(not_now.reply)
        assert 0.08 < there.lasts_s(there.driver.read, not_now.kind, not_now.code) < there.max_age_s
        there.hears_as_usual()
        assert there.driver.read().force_n == pytest.approx(_usual_n(device))
        assert set(there.wire.asked) == {device.reading}

    @pytest.mark.parametrize("after_s", [0.0, 0.002])
    @pytest.mark.parametrize("part", [slice(None), slice(5)], ids=["whole", "its beginning"])
    def test_a_late_reply_is_never_the_next_reading(self, device: ForceBytes, part: slice, after_s: float) -> None:
        """It comes before the next question, or after that and before its reply."""
        there = Connected(device)
        late = next(w for w in device.weights.values() if w.grams * GWT_N != pytest.approx(_usual_n(device)))
        there.wire.silent = True
        assert there.lasts_s(there.driver.read, ForceTimeout, "no_reply") < GIVES_UP_S
        there.wire.silent, there.wire.after_s = False, 0.01
        there.wire.send(
            device.said(there.wire.frames[-1] if there.wire.frames else UNASKED, late.reply)[part], after_s
        )
        assert there.driver.read().force_n == pytest.approx(_usual_n(device))
        assert there.driver.read().force_n == pytest.approx(_usual_n(device))

    # --- zero, and the wire ---

    def test_zero(self, device: ForceBytes, zeroing: Zeroing) -> None:
        there = Connected(device)
        there.answers(zeroing.replies)
        if zeroing.kind is None:
            there.driver.zero()
        else:
            assert there.lasts_s(there.driver.zero, zeroing.kind, zeroing.code) < 10.0 + GIVES_UP_S
        assert there.wire.asked.count(device.zero) == zeroing.told

    @pytest.mark.parametrize("chatter", [b"\xaa", b"xyz", b"S D 0.01 g\r\n"], ids=repr)
    def test_a_port_that_never_stops_talking_is_an_error_or_a_reading_in_bounded_time(
        self, device: ForceBytes, chatter: bytes
    ) -> None:
        there = Connected(device)
        begun_s = there.clock.monotonic_s()

        def chatting(timeout_s: float) -> bytes:
            there.clock.wait_s(1e-3)
            assert there.clock.monotonic_s() - begun_s < 2 * GIVES_UP_S
            return chatter

        there.wire.read = chatting  # type: ignore[method-assign]
        with suppress(ForceError, TransportError):
            there.driver.read()

    @pytest.mark.parametrize("cut", ["write and read", "read"])
    def test_a_cut_wire_is_an_error_of_its_own(self, device: ForceBytes, cut: str) -> None:
        """Before a request, or while its reply is awaited."""
        there = Connected(device)
        there.wire.cut = cut
        for ask in (there.driver.read, there.driver.zero, there.driver.connect):
            with pytest.raises(TransportError) as caught:
                ask()
            has_code(caught.value, "cut", port=PORT)

    def test_closing_it_closes_the_wire(self, device: ForceBytes) -> None:
        there = Connected(device)
        there.driver.close()
        assert there.wire.closed


def _usual_n(device: ForceBytes) -> float:
    """The force of the usual reply."""
    usual = device.usual[device.reading]
    return next(weight.grams for weight in device.weights.values() if weight.reply == usual) * GWT_N
