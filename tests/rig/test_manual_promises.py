"""What docs/safety_promises.md promises of manual control holds for what is asked over the socket, on every bench.

Each promise is a walk of a person at the panel; devices virtual, bytes real, clock virtual. What a single motion may
do to a finger: tests/rig/test_manual_steps.py.
"""

import math
from collections.abc import Callable, Iterator

import pytest

from rig.engine.contact import KnownContact
from rig.engine.sensing import ForceZero
from rig.manual.status import IN_STEPS
from rig.units import GWT_N
from tests.rig.hand_bench import APEX_MM, KINDS, HandBench, Person, is_stop

Make = Callable[..., HandBench]
ZERO = ForceZero(0.0, 0.0)

PROMISES: dict[str, Callable[[Make], None]] = {}


def promise(walk: Callable[[Make], None]) -> Callable[[Make], None]:
    PROMISES[walk.__name__.replace("_", " ")] = walk
    return walk


def ended(bench: HandBench, person: Person) -> str:
    """How the last thing that a person did ended."""
    return str(bench.run(person)["ended_by"])


# --- the force ---


@promise
def with_one_forces_count_from_the_last_zero_on_record(make: Make) -> None:
    bench = make(zero=ForceZero(3.0 * GWT_N, 0.0))
    bench.spring.offset_gwt = 5.0
    state = bench.run(bench.step("z", 0.5))
    assert state["force_gwt"] == pytest.approx(2.0, abs=0.011)
    assert state["zeroed"]


# --- the way ---


@promise
def a_stage_that_is_not_where_it_was_left_has_no_known_height(make: Make) -> None:
    """And counts as below clearance: one increment at a time."""
    bench = make(known=False, zero=ZERO)
    begun = len(bench.moves_sent())
    state = bench.run(bench.step("z", -0.5))
    assert (state["homed"], state["height_mm"]) == (False, None)
    assert state["next"] == IN_STEPS
    assert len(bench.moves_sent()) - begun == 10


@promise
def where_it_was_left_homed_it_is_known_and_left_to_the_next_command(make: Make) -> None:
    bench = make()
    assert bench.memory.read().left_at_mm is not None

    def person() -> Person:
        yield 0.1
        assert bench.memory.read().left_at_mm is None, "killed now, nobody knows"
        assert bench("status")["height_mm"] == pytest.approx(3.0, abs=0.003)
        yield from bench.step("z", 1.0)

    bench.run(person())
    left_mm = bench.memory.read().left_at_mm
    assert left_mm is not None
    assert left_mm[2] - APEX_MM == pytest.approx(bench.height_mm, abs=0.003)


@promise
def a_step_is_five_millimeters_at_most_and_none_is_queued(make: Make) -> None:
    """Whatever is clicked while it moves is refused; when the process or the page is gone, nothing more is sent."""
    bench = make(zero=ZERO)
    from_mm = bench.x_mm

    def person() -> Person:
        for by_mm in (5.1, 0.0, -1.0, math.inf):
            assert "by_mm" in bench.refusal("step", by_mm=by_mm if math.isfinite(by_mm) else "inf")
        bench("step", axis="x", sign=1, by_mm=5.0, tab="one")
        while bench("status")["busy"] is not None:
            assert (bench("status")["busy"], bench("status")["tab"]) == ("step", "one")
            assert bench.refusal("step") == bench.refusal("home") == "busy: step"
            yield 0.05
        yield 2.0

    assert ended(bench, person()) == "None"
    assert bench.x_mm - from_mm == pytest.approx(5.0, abs=0.003)


@promise
def once_the_position_is_lost_it_moves_sideways_only_where_nothing_is_felt(make: Make) -> None:
    """A lift is on record. Then the stage loses its position, and the finger comes up."""
    bench = make(zero=ZERO, lifted=True)

    def person() -> Person:
        yield from bench.step("x", 0.5)
        assert bench("status")["ended_by"] is None
        bench.bench.stage.stop()
        yield 0.3
        bench.spring.skin_mm = bench.height_mm + 0.3
        yield 1.0
        from_mm = bench.x_mm
        assert not bench("status")["homed"]
        yield from bench.step("x", 1.0)
        assert "no step sideways" in bench("status")["ended_by"]
        assert bench.x_mm == from_mm
        bench.spring.skin_mm = 0.0
        yield 1.0
        yield from bench.step("x", 1.0)
        assert bench.x_mm > from_mm

    assert ended(bench, person()) == "None"


@promise
def after_a_homing_that_a_touch_ended_only_homing_follows(make: Make) -> None:
    bench = make(zero=ZERO, lifted=True, soft_trip_n=0.05)

    def person() -> Person:
        bench("home")
        yield 0.6
        bench.spring.offset_gwt = 10.0  # something is pushed against the indentor
        yield from bench.done()
        assert "exceeds the soft trip" in bench("status")["ended_by"]
        bench.spring.offset_gwt, from_mm = 2.0, bench.x_mm
        yield 1.0
        yield from bench.step("x", 1.0)
        assert "home first" in bench("status")["ended_by"]
        assert bench.x_mm == from_mm

    bench.run(person())


# --- home, zero, stop ---


@promise
def homed_the_height_is_known_and_a_touch_of_before_is_forgotten(make: Make) -> None:
    bench = make(above_mm=0.2, known=False)

    def person() -> Person:
        yield from bench.step("z", -1.0)
        assert bench("status")["ended_by"].startswith("touched")
        yield from bench.do("home")
        state = bench("status")
        assert (state["ended_by"], state["homed"]) == (None, True)
        assert state["height_mm"] == pytest.approx(bench.height_mm, abs=0.003)
        bench.spring.k_gwt, bench.spring.offset_gwt = 0.0, 0.0
        bench.spring.wall_x_mm = -1000.0  # something is met at once, wherever it goes
        bench.spring.true_gwt = lambda t_s: 3.0 * (bench.height_mm < 22.0)  # type: ignore[method-assign]
        yield from bench.step("z", -5.0)

    assert ended(bench, person()).startswith("touched, 3.00 gwt more")


@promise
def zero_is_refused_where_something_seems_touched_and_taken_anyway(make: Make) -> None:
    bench = make(zero=ZERO)
    bench.spring.offset_gwt = 2.0

    def person() -> Person:
        yield from bench.do("zero")
        assert bench("status")["ended_by"].startswith("the sensor reads 2.00 gwt from the last recorded zero (20")
        assert bench("status")["did"] == "zero", "so that the page offers to zero anyway"
        assert bench.memory.read().zero == ZERO
        yield from bench.do("zero", anyway="yes")
        assert "so nothing was zeroed" in bench("status")["ended_by"], "anyway is true or nothing"
        yield from bench.do("zero", anyway=True)
        assert bench("status")["ended_by"] is None
        assert bench("status")["force_gwt"] == pytest.approx(0.0, abs=0.011)
        yield from bench.do("zero")

    state = bench.run(person())
    assert (state["ended_by"], state["zeroed"]) == (None, True)
    assert bench.memory.read().zero_unix_s > 1.7e9


@promise
def without_a_zero_on_record_the_record_of_contact_refuses_one(make: Make) -> None:
    """A run was killed in the finger. Its load is not to become the zero, from which nothing seems touched."""
    bench = make(above_mm=-0.5, known=False)
    bench.memory.touched(KnownContact("unknown", 2.0))

    def person() -> Person:
        yield from bench.do("zero")
        assert "there is no zero on record, and the indentor is at an unknown position" in bench("status")["ended_by"]
        assert bench.memory.read().zero is None
        yield from bench.do("home")
        yield from bench.do("zero")
        assert bench("status")["ended_by"] is None

    assert ended(bench, person()) == "None"
    assert bench.memory.read().zero is not None


def _idle(bench: HandBench) -> Person:
    yield 0.31


def _stepping(bench: HandBench) -> Person:
    bench("step", axis="x", sign=1, by_mm=5.0, tab="one")
    yield 2.0  # Contact is measured first.


def _stepping_up(bench: HandBench) -> Person:
    bench("step", axis="z", sign=1, by_mm=5.0, tab="one")
    yield 0.8


def _stepping_down(bench: HandBench) -> Person:
    bench("step", axis="z", sign=-1, by_mm=1.0, tab="one")
    yield 0.8


def _homing(bench: HandBench) -> Person:
    bench("home")
    yield 1.0


def _zeroing(bench: HandBench) -> Person:
    bench("zero")
    yield 0.2


def _about_to_home(bench: HandBench) -> Person:
    yield 0.1
    bench("home")


STATES = {
    walk.__name__[1:]: walk
    for walk in (_idle, _stepping, _stepping_up, _stepping_down, _homing, _zeroing, _about_to_home)
}


@pytest.mark.quick(rows=lambda state, kind: kind == "grbl" or state in ("stepping", "homing"))
@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("kind", KINDS)
def test_a_manual_stop_is_sent_at_once_in_every_state_and_only_homing_moves_after(kind: str, state: str) -> None:
    """The byte in the log at the instant of the request, no move behind it; then home, and nothing else, moves."""
    bench = HandBench(kind, zero=ZERO)
    stopped_s: list[float] = []
    at_mm: list[tuple[float, float]] = []

    def person() -> Iterator[float]:
        yield from STATES[state](bench)
        stopped_s.append(bench.clock.monotonic_s())
        assert bench("stop") == {"stopped": True}
        yield from bench.done()
        yield 1.0
        found = bench("status")
        assert (found["stopped"], found["homed"], found["busy"]) == (True, False, None)
        assert found["next"].startswith("home first; nothing else moves until then")
        at_mm.append((bench.x_mm, bench.height_mm))
        for more in (bench.step("z", 0.5), bench.do("zero")):
            yield from more
        assert bench.refused[-2:] == [f"stopped: {found['next']}"] * 2
        yield 1.0
        at_mm.append((bench.x_mm, bench.height_mm))
        yield from bench.do("home")
        found = bench("status")
        assert (found["ended_by"], found["stopped"], found["homed"]) == (None, False, True)
        yield from bench.step("x", -0.5)

    end = bench.run(person())
    assert end["ended_by"] is None
    first_s, first = next((t_s, data) for t_s, data in bench.sent() if t_s > stopped_s[0] - 1e-6)
    assert first_s == pytest.approx(stopped_s[0], abs=1e-6)
    assert is_stop(kind, first)
    assert at_mm[0] == at_mm[1]
    homed_s = min(t_s for t_s in bench.moves_sent() if t_s > stopped_s[0])
    assert homed_s >= stopped_s[0] + 2.0, "no move but the homing that was asked for"
    if state not in ("idle", "zeroing"):
        did = [line for line in bench.wire.getvalue().splitlines() if '"did"' in line]
        assert state == "about_to_home" or '"stopped at once by the operator"' in did[0]


@pytest.mark.quick(rows=lambda name, kind: kind == "grbl")  # drives: test_manual_steps.py, test_hand_owner.py
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", PROMISES)
def test_every_promise_of_manual_control_holds_over_the_control_socket(name: str, kind: str) -> None:
    PROMISES[name](lambda **options: HandBench(kind, **options))
