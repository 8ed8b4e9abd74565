"""Jogs by a distance from rest, and the keys of `rig jog`."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from rig.cli.jog import QUIET_S, KeySteps, way
from rig.devices.base import StageError, StageHeld, StageRejected, StageStatus
from rig.devices.grbl import GrblStage
from rig.engine.contact import KnownContact
from rig.engine.motion import DOWN, UP, Direction, StrayedError, jog, lift_from_rest
from rig.engine.steps import MOST_MM, StepEnd
from rig.errors import BadInputError, LimitError
from rig.transport import LoopbackTransport, TransportError
from sim.devices import SerialLine, VirtualGrbl
from sim.devices.clock import VirtualClock
from tests.error_codes import raises
from tests.stub_bench import StubStage

LEFT = Direction("x", -1)


class Bench:
    """An unlocked board at its zero, with a driver."""

    def __init__(self) -> None:
        self.clock = VirtualClock()
        line = SerialLine(self.clock, 115200)
        self.board = VirtualGrbl(self.clock, line)
        self.wire = LoopbackTransport(line, self.clock)
        self.stage = GrblStage(self.wire, self.clock)
        self.stage.connect()
        self.stage.unlock()
        self.zero = self.board.carriage_steps_at(self.clock.monotonic_s())[0]

    def x_mm(self, t_s: float | None = None) -> float:
        """Where the carriage is, or will be by t_s if nobody says anything more."""
        t_s = self.clock.monotonic_s() if t_s is None else t_s
        return (self.board.carriage_steps_at(t_s)[0] - self.zero) / 400


def test_a_jog_covers_its_distance_within_one_motor_step() -> None:
    bench = Bench()
    jog(bench.stage, bench.clock, LEFT, 1.2345, 3.0)
    assert bench.stage.status().x_mm == pytest.approx(-1.2345, abs=0.0025)


def test_an_interrupt_ends_a_jog_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench()
    until_s, status = bench.clock.monotonic_s() + 0.5, bench.stage.status

    def interrupted() -> StageStatus:
        if bench.clock.monotonic_s() > until_s:
            monkeypatch.setattr(bench.stage, "status", status)
            raise KeyboardInterrupt
        return status()

    monkeypatch.setattr(bench.stage, "status", interrupted)
    with pytest.raises(KeyboardInterrupt):
        jog(bench.stage, bench.clock, LEFT, 5.0, 5.0)
    assert bench.x_mm() == bench.x_mm(1e9), "at rest"
    assert -3.5 < bench.x_mm() < -1.0


def test_a_jog_whose_wire_is_cut_ends_at_its_own_distance(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench()
    cut_s, write = bench.clock.monotonic_s() + 0.3, bench.wire.write

    def cut(data: bytes) -> None:
        if bench.clock.monotonic_s() > cut_s:
            raise TransportError("the wire is cut", "cut")
        write(data)

    monkeypatch.setattr(bench.wire, "write", cut)
    with raises(TransportError, "cut"):
        jog(bench.stage, bench.clock, LEFT, MOST_MM, 5.0)
    assert bench.x_mm(1e9) == pytest.approx(-MOST_MM, abs=0.003)


def test_a_jog_beyond_the_travel_is_refused() -> None:
    bench = Bench()
    with raises(StageRejected, "line_refused"):
        jog(bench.stage, bench.clock, Direction("x", +1), 5.0, 1.0)
    assert bench.x_mm(1e9) == 0.0


class Scripted(StubStage):
    """Reports a state, and stops so far short of a jog's target."""

    def __init__(self, state: str = "Idle", short_mm: float = 0.0, aside_mm: float = 0.0) -> None:
        super().__init__(VirtualClock())
        self.state, self._short_mm, self._aside_mm = state, short_mm, aside_mm

    def jog(self, axis: str, mm: float, speed_mm_s: float) -> None:
        super().jog(axis, mm - self._short_mm * (1 if mm > 0 else -1), speed_mm_s)
        self.at_mm[1] += self._aside_mm


@pytest.mark.parametrize("state", ["Hold:0", "Door:1"])
def test_no_jog_is_sent_to_a_board_in_hold(state: str) -> None:
    stage = Scripted(state)
    with raises(StageHeld, "held"):
        jog(stage, stage.clock, LEFT, 1.0, 1.0)  # type: ignore[arg-type]
    assert stage.told == []


def test_a_jog_from_a_position_that_still_changes_is_refused() -> None:
    stage = Scripted()
    status, looks = stage.status, iter([0.0, 0.2])
    stage.status = lambda: replace(status(), x_mm=next(looks))  # type: ignore[method-assign]
    with raises(StageError, "not_at_rest"):
        jog(stage, stage.clock, LEFT, 1.0, 1.0)  # type: ignore[arg-type]
    assert stage.told == []


@pytest.mark.parametrize(("short_mm", "stopped"), [(0.0054, False), (0.0056, True), (0.5, True)])
def test_a_jog_that_rests_short_of_its_target_is_an_error(short_mm: float, stopped: bool) -> None:
    """By more than a step, 0.0025 mm, and what a board prints."""
    stage = Scripted(short_mm=short_mm)
    if not stopped:
        jog(stage, stage.clock, LEFT, 1.0, 1.0)  # type: ignore[arg-type]
        return
    with raises(StageError, "jog_cut_short"):
        jog(stage, stage.clock, LEFT, 1.0, 1.0)  # type: ignore[arg-type]


def test_a_jog_that_leaves_its_path_is_stopped() -> None:
    stage = Scripted(aside_mm=0.1)
    with raises(StrayedError, "off_its_way"):
        jog(stage, stage.clock, LEFT, 1.0, 1.0)  # type: ignore[arg-type]
    assert stage.told[-1] == "stop"


def test_a_lift_from_rest_is_made_in_parts_of_a_fifth_of_a_second() -> None:
    stage = Scripted()
    lift_from_rest(stage, stage.clock, 1.3, 3.0)  # type: ignore[arg-type]
    assert stage.told == [("jog", "z", pytest.approx(0.6)), ("jog", "z", pytest.approx(0.6)), ("jog", "z", 0.1)]


# --- keys ---


class Person:
    """Keys that come at instants, and a session that takes a second for each step."""

    def __init__(self, *typed: tuple[float, str], ends: dict[int, Exception] | None = None) -> None:
        self.clock = VirtualClock()
        self._typed, self._ends = list(typed), ends or {}
        self.steps: list[tuple[Direction, float]] = []
        self.did: list[str] = []

    def read(self) -> bytes | None:
        now_s = self.clock.monotonic_s()
        due = "".join(key for at_s, key in self._typed if at_s <= now_s)
        self._typed = [(at_s, key) for at_s, key in self._typed if at_s > now_s]
        return None if not (due or self._typed) else due.encode()

    def step(self, direction: Direction, by_mm: float, speed_mm_s: float) -> StepEnd:
        self.steps.append((direction, by_mm))
        self.clock.wait_s(1.0)
        problem = self._ends.get(len(self.steps))
        return StepEnd(KnownContact(), None, problem)  # type: ignore[arg-type]

    def look(self) -> StageStatus:
        return StageStatus("Idle", 0.0, 0.0, 0.0)

    def __getattr__(self, name: str) -> Callable[[], None]:
        return lambda: self.did.append(name)

    def run(self) -> KeySteps:
        keys = KeySteps(self, self.clock, self.read, lambda *shown: None, 2.0)  # type: ignore[arg-type]
        keys.run()
        return keys


def test_each_key_makes_one_step_of_the_chosen_size() -> None:
    person = Person(*((2.0 * n, key) for n, key in enumerate("d5s+w1-a2s3s4s6s")), (99.0, "q"))
    person.run()
    assert person.steps[:4] == [(Direction("x", 1), 0.1), (DOWN, 1.0), (UP, 5.0), (Direction("x", -1), 0.01)]
    assert person.steps[4:] == [(DOWN, 0.05), (DOWN, 0.1), (DOWN, 0.5), (DOWN, 5.0)]


def test_the_keys_h_z_and_p_home_zero_and_park() -> None:
    person = Person((0.1, "h"), (0.5, "z"), (1.0, "p"), (1.5, "?"), (2.0, "q"))
    person.run()
    assert [name for name in person.did if name != "force_gwt"] == ["home", "zero", "park"]


def test_keys_typed_while_a_step_moves_are_dropped() -> None:
    """A held key repeats 30 times a second."""
    person = Person(*((0.1 + n / 30, "s") for n in range(40)), (3.0, "q"))
    person.run()
    assert len(person.steps) == 2, "no repeat runs ahead"


def test_several_keys_at_once_make_one_step() -> None:
    person = Person((0.1, "sss\x1b[B"), (3.0, "q"))
    person.run()
    assert len(person.steps) == 1


def test_a_held_key_starts_no_step_after_one_that_ended_early() -> None:
    held = ((0.1 + n / 30, "s") for n in range(150))
    person = Person(*held, (7.0, "s"), (9.0, "q"), ends={1: LimitError("touched", "touched")})
    person.run()
    assert len(person.steps) == 2, "the second is a new press"


def test_the_quiet_time_after_a_step_exceeds_the_repeat_delay_of_a_held_key() -> None:
    """A key repeats after 0.66 s at the latest."""
    assert QUIET_S > 0.66


@pytest.mark.parametrize("last", ["q", ""])
def test_q_or_the_end_of_input_ends_rig_jog_during_a_step(last: str) -> None:
    person = Person((0.1, "s"), (0.5, last))
    person.run()
    assert len(person.steps) == 1


# --- the distance ---


@pytest.mark.parametrize(("axis", "by_mm", "sign"), [("x", 1.0, 1), ("z", -5.0, -1)])
def test_the_sign_of_a_distance_sets_the_direction_of_a_jog(axis: Any, by_mm: float, sign: int) -> None:
    assert way(axis, by_mm, MOST_MM) == (Direction(axis, sign), abs(by_mm))


@pytest.mark.parametrize(
    ("axis", "by_mm", "code"),
    [("u", 1.0, "unknown_choice"), ("x", 0.0, "outside_range"), ("x", 5.01, "outside_range"),
     ("x", float("nan"), "outside_range"), ("z", -1e9, "outside_range")],
)  # fmt: skip
def test_rig_jog_refuses_a_distance_of_zero_or_beyond_its_limit(axis: str, by_mm: float, code: str) -> None:
    with raises(BadInputError, code):
        way(axis, by_mm, MOST_MM)
