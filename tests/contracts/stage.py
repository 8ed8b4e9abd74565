"""The contract of a stage: what every driver does with what its controller says, whatever the controller is.

A controller is one table of bytes in `tests/contracts/bytes/`, quoted from its documentation, and nothing else.
"""

import math
import pickle
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, field, replace
from itertools import pairwise, product
from typing import Any, ClassVar

import pytest

from rig.devices.base import (
    LOOK_S,
    MoveError,
    Stage,
    StageAlarm,
    StageError,
    StageNotHomed,
    StageRejected,
    StageStatus,
    StageTimeout,
)
from rig.devices.registry import KnownBench, StageKind, find
from rig.errors import RigError
from rig.transport import TransportError
from sim.devices.clock import VirtualClock
from tests.error_codes import raises

PORT, BEGUN_S = "wire", 1000.0
SILENCE = b""
GIVES_UP_S = 10.0
"""After so long without a reply every driver says so; a reset that is waited for twice is the longest."""
TRIES = 3
"""No question is asked more often without a reply that is one."""

Replies = Mapping[bytes, bytes | tuple[bytes, str]]
"""What is asked or commanded, and the reply; with it the state that the controller is in from then on."""


def as_it_is(data: bytes) -> bytes:
    """The bytes themselves."""
    return data


@dataclass(frozen=True)
class Garbled:
    """A reply to the question where the stage is, and the error that it is; mangled: what becomes of its frame."""

    reply: bytes
    kind: type[StageError]
    code: str
    mangled: Callable[[bytes], bytes] = as_it_is


@dataclass(frozen=True)
class Shown:
    """What a controller shows of z, under way and at rest, and the error codes that follow; "" for none.

    codes: at a look of a motion, of a status at rest, and before a motion. number: of an alarm.
    """

    moving: Replies
    rest: Replies
    codes: tuple[str, str, str]
    number: int | str | None = None


@dataclass(frozen=True)
class HomingEnd:
    """What z shows in a state of its homing, and then, and whether it is homed with it."""

    state: str
    shows: Replies
    homed: bool = False
    then: Replies = field(default_factory=dict)


@dataclass(frozen=True)
class Limit:
    """A lower limit that the controller has been given by these frames, in turn.

    unconfirmed: a question, the reply that shows another limit, and the code of that error.
    """

    lowest_z_mm: float
    frames: Sequence[bytes]
    unconfirmed: tuple[bytes, bytes, str]


@dataclass(frozen=True, kw_only=True)
class StageBytes:
    """What a controller is asked, and what its replies mean.

    name: of the table. kind: as in the catalogue; table: of [stage]. usual: replies in every state but where
    `states` say otherwise. It begins in the state "new". A motion leads to "moving", and the test from there to
    "arrived", "elsewhere", "held" or "alarm". where: the question where the stage is.

    move: arguments of move_to(), from home to `arrived`; trigger: the frame before which nothing moves. stop: the
    frames of a stop, all in one write; halt: the first one of a halt. unlock: how unlock() is refused, with the
    maker's number; refusals: replies with other numbers, by number; the code is the same. held: the error where
    somebody stops it at the controller. lacks: what it cannot do, and why. ports: of a controller with several, what
    stands before the frames on each. settings: questions for a setting that must be as configured, with other replies
    and the word that the error has for it. fault_words, refusal_words: by number, a word of the manual that the error
    has, too; "" where the manual has none, or the number is one. shows: what is noticed, and what is not. ends: of
    homing. search: what z shows while it searches home at a height (mm) and a speed (mm/s), with the home or the far
    switch active.

    For the twin: framed: the frame of a question or a command. alarmed: the accident that leads to "alarm". alike: a
    reply without what each device has of its own, such as a serial number or a voltage. not_on_twin: questions,
    commands and states that are not tried, and why.
    """

    name: str
    kind: str
    source: str
    table: Mapping[str, Any] = field(default_factory=dict)
    identity: str
    ports: Mapping[str, bytes] = field(default_factory=dict)
    usual: Replies
    states: Mapping[str, Replies]
    where: bytes
    move: Mapping[str, float]
    home: StageStatus
    under_way: StageStatus | None
    arrived: StageStatus
    trigger: bytes
    stop: Sequence[bytes]
    halt: bytes
    unlock: tuple[bytes, bytes, str, int | str]
    refusals: Mapping[int | str, bytes]
    alarm: int | str
    held: tuple[type[StageError], str]
    garbled: Mapping[str, Garbled]
    fault_words: Mapping[int | str, str] = field(default_factory=dict)
    refusal_words: Mapping[int | str, str] = field(default_factory=dict)
    settings: Sequence[tuple[bytes, bytes, str]] = ()
    shows: Mapping[str, Shown] = field(default_factory=dict)
    ends: Mapping[str, HomingEnd] = field(default_factory=dict)
    search: Callable[[float, float, str], Replies] | None = None
    limit: Limit | None = None
    lacks: Mapping[str, str] = field(default_factory=dict)
    frames: Callable[[bytes], Sequence[bytes]] = lambda data: [data]
    heard: Callable[[bytes], bytes] = as_it_is
    framed: Callable[[bytes], bytes] = as_it_is
    alarmed: Callable[[Any], object] | None = None
    alike: Callable[[bytes], bytes] = as_it_is
    not_on_twin: Mapping[bytes | str, str] = field(default_factory=dict)
    said: Callable[[bytes, bytes], bytes] = lambda frame, reply: reply


class StageEnd:
    """The wire, and a controller that replies by its table; a frame that is not in the table fails the test."""

    name = PORT

    def __init__(self, device: StageBytes, clock: VirtualClock) -> None:
        self.device, self.clock, self.closed = device, clock, False
        self.state, self.silent, self.cut = "new", False, False
        self.instead: dict[bytes, bytes] = {}
        self.mangled: Callable[[bytes], bytes] = as_it_is
        self.asked: list[bytes] = []
        self.writes: list[tuple[float, list[bytes]]] = []
        self._coming: dict[bytes, list[bytes]] = {}

    def write(self, data: bytes, port: bytes = b"") -> None:
        self._refuse_cut()
        frames = list(self.device.frames(data))
        self.writes.append((self.clock.monotonic_s(), [port + self.device.heard(frame) for frame in frames]))
        for frame in frames:
            self._hear(frame, port)

    def read(self, timeout_s: float, port: bytes = b"") -> bytes:
        self._refuse_cut()
        coming = self._coming.setdefault(port, [])
        if not coming:
            self.clock.wait_s(timeout_s)
        return coming.pop(0) if coming else b""

    def at(self, port: str) -> "StageEnd | PortEnd":
        """The wire at a port: this one, or one of several."""
        return PortEnd(self, self.device.ports[port]) if self.device.ports else self

    def close(self) -> None:
        self.closed = True

    def forget(self) -> None:
        """What was asked so far is of no interest."""
        self.asked.clear()
        self.writes.clear()

    def _hear(self, frame: bytes, port: bytes) -> None:
        asked = port + self.device.heard(frame)
        said = {**self.device.usual, **self.device.states[self.state], **self.instead}
        assert asked in said, f"{asked!r} is not in the table of {self.device.name}, state {self.state}"
        self.asked.append(asked)
        if self.silent:
            return
        found = said[asked]
        reply, self.state = found if isinstance(found, tuple) else (found, self.state)
        if reply:
            self._coming.setdefault(port, []).append(self.mangled(self.device.said(frame, reply)))

    def _refuse_cut(self) -> None:
        if self.cut:
            raise TransportError("the wire is cut")


class PortEnd:
    """One of the ports of a controller that has several."""

    name = PORT

    def __init__(self, end: StageEnd, port: bytes) -> None:
        self._end, self._port = end, port

    def write(self, data: bytes) -> None:
        self._end.write(data, self._port)

    def read(self, timeout_s: float) -> bytes:
        return self._end.read(timeout_s, self._port)

    def close(self) -> None:
        self._end.close()


class StageBench:
    """A driver of the catalogue on its controller, at a late hour of the clock."""

    def __init__(self, device: StageBytes, *, connected: bool = True, homed: bool = False) -> None:
        self.device = device
        self.clock = VirtualClock(1.7e9, BEGUN_S)
        self.wire = StageEnd(device, self.clock)
        settings = KnownBench.model_validate({"stage": {"kind": device.kind, **device.table}})
        self.stage: Stage = find(StageKind, device.kind).driver(self.wire.at, self.clock, settings)
        if connected or homed:
            self.stage.connect()
        if homed:
            self.stage.home()
            assert self.stage.homed
        self.wire.forget()

    def move(self) -> None:
        """To `arrived`, without looks."""
        self.stage.move_to(**self.device.move)

    def under_way(self) -> Iterator[StageStatus | None]:
        """A motion that has been looked at once."""
        looks = self.stage.moving(**self.device.move)
        next(looks)
        return looks

    @contextmanager
    def fails(self, kind: type[RigError], code: str, **fields: Any) -> Iterator[None]:
        """Expect an error in one line and in bounded time, which is the same behind a process."""
        begun_s = self.clock.monotonic_s()
        with raises(kind, code, **fields) as caught:
            yield
        assert self.clock.monotonic_s() - begun_s <= GIVES_UP_S
        as_seen = (type(caught.value), str(caught.value), repr(vars(caught.value)))
        again = pickle.loads(pickle.dumps(caught.value))
        assert (type(again), str(again), repr(vars(again))) == as_seen
        assert str(caught.value)
        assert "\n" not in str(caught.value)

    def refuses_to_move(self) -> None:
        """It is not homed, or it must be reset first; in any case nothing is sent."""
        self.wire.forget()
        assert not self.stage.homed
        with pytest.raises(StageError) as caught:
            self.move()
        assert caught.value.code in ("not_homed", "needs_reset"), repr(caught.value)
        assert self.wire.writes == []


Verb = Callable[[StageBench], object]
VERBS: dict[str, Verb] = {
    "connect": lambda bench: bench.stage.connect(),
    "home": lambda bench: bench.stage.home(),
    "status": lambda bench: bench.stage.status(),
    "look": lambda bench: bench.stage.look(),
    "move_to": lambda bench: bench.move(),
    "halt": lambda bench: bench.stage.halt(),
    "unlock": lambda bench: bench.stage.unlock(),
    "jog": lambda bench: bench.stage.jog("z", -0.1, 1.0),
}
NO_MOVES: list[tuple[str, dict[str, float]]] = [
    *(("not_finite", {"z_mm": number, "speed_mm_s": 1.0}) for number in (math.nan, math.inf, -math.inf)),
    *(("not_finite", {"x_mm": -1.0, "speed_mm_s": number}) for number in (math.nan, math.inf)),
    *(("too_slow", {"x_mm": -1.0, "speed_mm_s": number}) for number in (0.0, -1.0, 1e-9, 0.0166)),
]


class StageContract:
    """What is asked of every stage; a subclass says of which controllers."""

    devices: ClassVar[Sequence[StageBytes]] = ()

    def pytest_generate_tests(self, metafunc: pytest.Metafunc) -> None:
        """Every test for every controller, and for every row of its table."""
        for rows in ("garbled", "shows", "ends", "settings"):
            if rows in metafunc.fixturenames:
                cases = [
                    pytest.param(device, case, id=f"{device.name}-{name}")
                    for device in self.devices
                    for name, case in _named(getattr(device, rows))
                ]
                metafunc.parametrize(("device", rows), cases)
                return
        if "device" in metafunc.fixturenames:
            metafunc.parametrize("device", self.devices, ids=lambda device: device.name)

    # --- who it is ---

    def test_connecting_identifies_the_stage_and_homes_nothing(self, device: StageBytes) -> None:
        bench = StageBench(device, connected=False)
        assert not bench.stage.homed
        assert bench.stage.connect() == device.identity
        assert not bench.stage.homed
        assert device.trigger not in bench.wire.asked
        again = StageBench(device, homed=True)
        assert again.stage.connect() == device.identity
        assert not again.stage.homed, "what became of it meanwhile is not known"

    def test_closing_it_closes_the_wire(self, device: StageBytes) -> None:
        bench = StageBench(device)
        bench.stage.close()
        assert bench.wire.closed

    def test_a_setting_that_is_not_as_configured_is_refused_before_anything_moves(
        self, device: StageBytes, settings: tuple[bytes, bytes, str]
    ) -> None:
        asked, reply, word = settings
        bench = StageBench(device, connected=False)
        bench.wire.instead[asked] = reply
        with bench.fails(StageError, "not_as_configured", word=word, port=PORT):
            bench.stage.connect()
        assert device.trigger not in bench.wire.asked

    # --- homed or nothing moves ---

    def test_unhomed_nothing_is_sent_for_a_move(self, device: StageBytes) -> None:
        bench = StageBench(device)
        with bench.fails(StageNotHomed, "not_homed"):
            bench.move()
        assert bench.wire.writes == []

    def test_homing_ends_at_home_and_the_position_is_trusted_only_then(self, device: StageBytes) -> None:
        bench = StageBench(device)
        trusted = [bench.stage.homed for _ in bench.stage.homing()]
        assert not any(trusted)
        assert bench.stage.homed
        assert bench.stage.status() == device.home

    def test_homing_that_ends_otherwise_than_at_home_is_no_homing(self, device: StageBytes, ends: HomingEnd) -> None:
        shows = {**device.states[ends.state], **ends.shows}
        states = {**device.states, ends.state: shows, "then": {**shows, **ends.then}}
        bench = StageBench(replace(device, states=states))
        with nullcontext() if ends.homed else bench.fails(StageError, "did_not_home", axis="z"):
            bench.stage.home()
        assert bench.stage.homed is ends.homed

    @pytest.mark.parametrize(("code", "move"), NO_MOVES, ids=str)
    def test_what_is_no_move_is_refused_before_any_byte(
        self, device: StageBytes, code: str, move: dict[str, float]
    ) -> None:
        bench = StageBench(device, homed=True)
        with bench.fails(MoveError, code):
            bench.stage.move_to(**move)
        with pytest.raises(MoveError) as caught:
            bench.stage.move_to(speed_mm_s=1.0)
        assert caught.value.code in ("no_target", "not_one_axis")
        assert bench.wire.writes == []
        assert bench.stage.homed

    @pytest.mark.parametrize("homed", [True, False])
    def test_what_is_no_jog_is_refused_before_any_byte(self, device: StageBytes, homed: bool) -> None:
        bench = StageBench(device, homed=homed)
        for by_mm in (math.nan, math.inf, -math.inf):
            with bench.fails(MoveError, "not_finite"):
                bench.stage.jog("z", by_mm, 1.0)
        with bench.fails(MoveError, "too_slow"):
            bench.stage.jog("z", -0.1, 1e-9)
        assert bench.wire.writes == []
        assert bench.stage.homed is homed

    # --- a motion ---

    def test_a_motion_can_be_looked_at(self, device: StageBytes) -> None:
        """Each tenth of a second, from its trigger to its arrival; nothing is asked of it a second time."""
        bench = StageBench(device, homed=True)
        looks, seen_s = bench.stage.moving(**device.move), list[float]()
        for look in looks:
            assert look is None or look == device.under_way
            assert bench.stage.homed
            seen_s.append(bench.clock.monotonic_s())
            if len(seen_s) == 5:
                bench.wire.state = "arrived"
        assert seen_s[0] - BEGUN_S > 0
        assert [later - before for before, later in pairwise(seen_s)] == pytest.approx([LOOK_S] * 4, abs=0.03)
        assert bench.wire.asked.count(device.trigger) == 1
        assert bench.stage.homed
        assert bench.stage.status() == device.arrived

    def test_an_arrival_elsewhere_is_an_error(self, device: StageBytes) -> None:
        bench = StageBench(device, homed=True)
        looks = bench.under_way()
        bench.wire.state = "elsewhere"
        (target_mm,) = (mm for name, mm in device.move.items() if name != "speed_mm_s")
        with bench.fails(StageError, "not_there", target_mm=target_mm):
            list(looks)

    def test_a_motion_has_half_as_much_time_again_and_5_s(self, device: StageBytes) -> None:
        """Later it is an error; the time to speed up counts, too, and is less than 0.2 s here."""
        (name, to_mm), speed_mm_s = next(iter(device.move.items())), device.move["speed_mm_s"]
        most_s = 1.5 * abs(to_mm - getattr(device.home, name)) / speed_mm_s + 5.0
        bench = StageBench(device, homed=True)
        in_time_s = bench.clock.monotonic_s() + most_s - 0.3
        bench.clock.call_at(in_time_s, lambda: setattr(bench.wire, "state", "arrived"))
        bench.move()
        assert bench.stage.status() == device.arrived
        bench = StageBench(device, homed=True)
        begun_s = bench.clock.monotonic_s()
        with raises(StageTimeout, "not_over"):
            bench.move()
        assert most_s <= bench.clock.monotonic_s() - begun_s <= most_s + 0.5

    def test_an_alarm_under_way_has_the_makers_number_and_loses_the_position(self, device: StageBytes) -> None:
        bench = StageBench(device, homed=True)
        looks = bench.under_way()
        bench.wire.state = "alarm"
        begun_s = bench.clock.monotonic_s()
        with bench.fails(StageAlarm, "alarm", number=device.alarm, words=device.fault_words[device.alarm]):
            list(looks)
        assert bench.clock.monotonic_s() - begun_s <= 0.3
        bench.refuses_to_move()

    def test_an_alarm_before_a_motion_is_reported_and_nothing_begins(self, device: StageBytes) -> None:
        bench = StageBench(device, homed=True)
        bench.wire.state = "alarm"
        with bench.fails(StageAlarm, "alarm", number=device.alarm):
            bench.move()
        assert device.trigger not in bench.wire.asked
        bench.refuses_to_move()

    def test_a_stage_that_somebody_holds_is_reported(self, device: StageBytes) -> None:
        """Under way at the next look, and before a motion, which is then not begun."""
        kind, code = device.held
        bench = StageBench(device, homed=True)
        looks = bench.under_way()
        bench.wire.state = "held"
        begun_s = bench.clock.monotonic_s()
        with bench.fails(kind, code):
            list(looks)
        assert bench.clock.monotonic_s() - begun_s <= 0.3
        bench = StageBench(device, homed=True)
        bench.wire.state = "held"
        with bench.fails(kind, code):
            bench.move()
        assert device.trigger not in bench.wire.asked

    def test_what_a_controller_shows_is_noticed_at_the_next_look_and_before_a_motion(
        self, device: StageBytes, shows: Shown
    ) -> None:
        number: dict[str, Any] = {} if shows.number is None else {"number": shows.number}
        at_look, at_rest, before = shows.codes
        for code, replies, begins in (
            (at_look, shows.moving, False),
            (at_rest, shows.rest, None),
            (before, shows.rest, True),
        ):
            bench = StageBench(device, homed=True)
            looks = bench.stage.moving(**device.move)
            if begins is False:
                next(looks)
            bench.wire.instead.update(replies)
            if code == "alarm" and shows.number is not None:
                number["words"] = device.fault_words[shows.number]
            with raises(StageError, code, **number) if code else suppress(StageError) if begins else nullcontext():
                bench.stage.status() if begins is None else next(looks)
            assert not code or bench.stage.homed is (code in ("held", "overridden"))
            assert begins is None or (device.trigger in bench.wire.asked) is not bool(begins and code)

    # --- the ends of it ---

    @pytest.mark.parametrize("homed", [True, False])
    def test_a_halt_ends_at_rest_and_keeps_the_position_as_it_was(self, device: StageBytes, homed: bool) -> None:
        bench = StageBench(device, homed=homed)
        if homed:
            bench.under_way()
        else:
            bench.wire.state = "moving"
        bench.wire.forget()
        bench.stage.halt()
        assert bench.wire.asked[0] == device.halt
        assert bench.wire.state == "rested", "the halt ends when the stage stands"
        assert bench.stage.homed is homed

    def test_a_stop_goes_out_at_once_past_all_that_is_waited_for(self, device: StageBytes) -> None:
        """In the middle of a motion that the driver waits for: one write, at that instant, before it reads."""
        bench = StageBench(device, homed=True)
        looks = bench.under_way()
        at_s, heard = bench.clock.monotonic_s() + 0.0312, list[tuple[float, list[bytes]]]()

        def stop() -> None:
            bench.wire.forget()
            bench.stage.stop()
            heard.extend(bench.wire.writes)

        bench.clock.call_at(at_s, stop)
        with pytest.raises(StageError) as caught:
            list(looks)
        assert caught.value.code in ("alarm", "stopped", "was_reset"), repr(caught.value)
        assert heard[0][0] == pytest.approx(at_s)
        assert heard[0][1] == list(device.stop)
        bench.refuses_to_move()

    def test_a_stop_needs_no_connection(self, device: StageBytes) -> None:
        bench = StageBench(device, connected=False)
        bench.stage.stop()
        assert bench.wire.writes[0][1] == list(device.stop)
        assert not bench.stage.homed

    @pytest.mark.parametrize("verb", VERBS)
    def test_a_silent_port_is_a_timeout_with_a_code(self, device: StageBytes, verb: str) -> None:
        bench = StageBench(device, homed=True)
        bench.wire.silent = True
        begun_s = bench.clock.monotonic_s()
        with pytest.raises(StageTimeout) as caught:
            VERBS[verb](bench)
        assert 0.1 < bench.clock.monotonic_s() - begun_s < GIVES_UP_S
        assert caught.value.code in ("no_reply", "no_status", "no_banner"), repr(caught.value)
        assert PORT in str(caught.value)
        assert bench.wire.asked.count(device.trigger) <= 1, "it may have been obeyed"
        if verb in ("connect", "status", "look"):
            assert bench.wire.asked.count(bench.wire.asked[0]) <= TRIES

    @pytest.mark.parametrize("verb", ["home", "move_to"])
    def test_a_command_without_a_reply_is_not_sent_again(self, device: StageBytes, verb: str) -> None:
        """It may have been obeyed, and it may have been lost."""
        bench, commands = StageBench(device, homed=verb == "move_to"), list[bytes]()
        hear = bench.wire._hear

        def losing(frame: bytes, port: bytes) -> None:
            asked = port + device.heard(frame)
            if isinstance({**device.usual, **device.states[bench.wire.state]}.get(asked), tuple):
                commands.append(asked)
            else:
                hear(frame, port)

        bench.wire._hear = losing  # type: ignore[method-assign]
        with pytest.raises(StageError):
            VERBS[verb](bench)
        assert commands.count(commands[0]) == 1
        assert not bench.stage.homed

    def test_a_question_whose_reply_is_lost_is_asked_again(self, device: StageBytes) -> None:
        bench = StageBench(device, homed=True)
        lost, hear = [1], bench.wire._hear
        bench.wire._hear = lambda frame, port: None if lost and lost.pop() else hear(frame, port)  # type: ignore[method-assign]
        assert bench.stage.status() == device.home
        assert not lost

    @pytest.mark.parametrize("verb", ["connect", "home", "move_to"])
    def test_after_a_silence_that_may_have_moved_it_the_position_is_lost(self, device: StageBytes, verb: str) -> None:
        bench = StageBench(device, homed=True)
        bench.wire.silent = True
        with pytest.raises(StageTimeout):
            VERBS[verb](bench)
        bench.wire.silent = False
        bench.refuses_to_move()

    def test_a_garbled_reply_is_an_error_with_a_code(self, device: StageBytes, garbled: Garbled) -> None:
        bench = StageBench(device, homed=True)
        shown = (
            {} if garbled.code == StageRejected.default_code else {"port": PORT}
        )  # a refusal names the line instead
        with bench.fails(garbled.kind, garbled.code, **shown):
            _garbled(bench, garbled)
        assert bench.wire.asked.count(device.where) <= TRIES
        bench.wire.instead.clear()
        bench.wire.mangled = as_it_is
        assert bench.stage.status() == device.home, "the next one is believed"

    def test_a_reply_with_a_wrong_bit_is_an_error_or_is_not_believed(self, device: StageBytes) -> None:
        """Where a checksum shows it: what is read is what was said."""
        if "checksum" in device.lacks:
            return
        bench = StageBench(device, homed=True)
        for place, bit in product(range(64), (0, 3, 7)):
            bench.wire.mangled = (
                lambda frame, place=place, bit=bit: (  # type: ignore[misc]
                    frame[:place] + bytes([frame[place] ^ 1 << bit]) + frame[place + 1 :]
                    if place < len(frame)
                    else frame
                )
            )
            try:
                found = bench.stage.status()
            except StageError:
                bench = StageBench(device, homed=True)
            else:
                assert found == device.home, (place, bit)

    @pytest.mark.parametrize("waits", [True, False], ids=["slow", "at once"])
    @pytest.mark.parametrize("chatter", [b"\xaa", b"xyz", b"!02 1 IDLE --:95\r\n"], ids=repr)
    def test_a_port_that_never_stops_talking_is_an_error_in_bounded_time(
        self, device: StageBytes, chatter: bytes, waits: bool
    ) -> None:
        """Whether its bytes come by and by, or are always there."""
        bench = StageBench(device, homed=True)

        def chatting(timeout_s: float, port: bytes = b"") -> bytes:
            bench.clock.wait_s(min(timeout_s, 0.01) if waits else 1e-3)
            return b"" if waits and timeout_s < 0.01 else chatter

        bench.wire.read = chatting  # type: ignore[method-assign]
        begun_s = bench.clock.monotonic_s()
        with pytest.raises((StageError, TransportError)):
            bench.stage.status()
        assert bench.clock.monotonic_s() - begun_s < GIVES_UP_S

    def test_a_refusal_has_the_makers_number(self, device: StageBytes) -> None:
        asked, said, code, own = device.unlock
        for number, reply in {own: said, **device.refusals}.items():
            bench = StageBench(device)
            with bench.fails(StageError, code, number=number, words=device.refusal_words[number]):
                _refused(bench, asked, reply)

    def test_an_unlocked_stage_has_to_be_homed(self, device: StageBytes) -> None:
        bench = StageBench(device, homed=True)
        bench.stage.unlock()
        bench.refuses_to_move()

    def test_a_cut_wire_is_an_error_of_its_own(self, device: StageBytes) -> None:
        stop: Verb = lambda bench: bench.stage.stop()  # noqa: E731
        for act in (*VERBS.values(), stop):
            bench = StageBench(device, homed=True)
            bench.wire.cut = True
            with pytest.raises(TransportError):
                act(bench)
        assert not bench.stage.homed

    # --- limits, outputs ---

    def test_a_lower_limit_is_the_controllers_or_none(self, device: StageBytes) -> None:
        limit, bench = device.limit, StageBench(device, homed=True)
        if limit is None:
            assert device.lacks["limit"]
            bench.stage.limit_depth(-26.5)
            assert bench.wire.writes == []
            return
        bench.stage.limit_depth(limit.lowest_z_mm)
        assert [frame for frame in bench.wire.asked if frame in limit.frames] == list(limit.frames)
        assert bench.stage.homed
        unhomed = StageBench(device)
        with unhomed.fails(StageNotHomed, "not_homed"):
            unhomed.stage.limit_depth(limit.lowest_z_mm)
        with bench.fails(MoveError, "not_finite"):
            bench.stage.limit_depth(math.nan)
        assert unhomed.wire.writes == []
        with bench.fails(StageError, limit.unconfirmed[-1]):
            _unconfirmed(bench, limit)
        bench.refuses_to_move()

    def test_inputs_that_it_cannot_report_are_none(self, device: StageBytes) -> None:
        """Before any byte."""
        kind, bench = find(StageKind, device.kind), StageBench(device, homed=True)
        if not kind.inputs:
            assert bench.stage.active_inputs() == frozenset()
        assert bench.wire.writes == []

    def test_an_output_that_is_not_configured_is_none(self, device: StageBytes) -> None:
        bench = StageBench(device, homed=True)
        for on in (True, False):
            with bench.fails(StageError, "no_output"):
                bench.stage.set_output(on)
        assert bench.wire.writes == []
        assert bench.stage.homed


def _named(rows: Any) -> list[tuple[str, Any]]:
    """The rows of a table, with their names."""
    return (
        list(rows.items()) if isinstance(rows, Mapping) else [(f"{row[-1]}-{n}", row) for n, row in enumerate(rows)]
    )


def _garbled(bench: StageBench, garbled: Garbled) -> None:
    bench.wire.instead[bench.device.where], bench.wire.mangled = garbled.reply, garbled.mangled
    bench.stage.status()


def _refused(bench: StageBench, asked: bytes, reply: bytes) -> None:
    bench.wire.instead[asked] = reply
    bench.stage.unlock()


def _unconfirmed(bench: StageBench, limit: Limit) -> None:
    asked, reply, _ = limit.unconfirmed
    bench.wire.instead[asked] = reply
    bench.stage.limit_depth(limit.lowest_z_mm)
