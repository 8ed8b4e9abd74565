"""Motions by hand over a stage and a sensor without a wire: each step that is told, what is felt, what is on record.

Clearance is 2 mm, an increment 0.05 mm, a step of the descent 0.5 mm, a touch 0.05 gwt, the deepest 1.5 mm. The
finger is F = 6 gwt/mm^1.5 below the nominal apex.
"""

from collections.abc import Callable
from typing import Any

import pytest

from rig.devices.base import ForceReading, StageError, StageStatus
from rig.engine.contact import KnownContact
from rig.engine.dead_man import DOWN, UP, Direction
from rig.engine.sensing import ForceZero, Sensing
from rig.manual.guard import Guard
from rig.manual.jog import ByHand, Moved
from rig.settings import RigSettings
from sim.devices.clock import VirtualClock
from tests.error_codes import printed
from tests.stub_bench import StubSensor, StubStage

ZERO = ForceZero(0.0, 0.0)
LEFT, RIGHT = Direction("x", -1), Direction("x", +1)


class Sensor(StubSensor):
    """Shows what `felt` says."""

    felt: Callable[[], float]

    def read(self) -> ForceReading:
        self.shows_gwt = self.felt()
        return super().read()


class Hand:
    """A person's motions over a finger, from so far above the nominal apex; `kept` is what is left on record."""

    def __init__(
        self,
        above_mm: float = 3.0,
        *,
        placed: bool = True,
        guarded: bool = True,
        zero: ForceZero | None = ZERO,
        may_touch: bool = False,
        **limits: Any,
    ) -> None:
        self.settings = RigSettings.model_validate({"limits": limits})
        self.clock = VirtualClock(1.7e9, 100.0)
        self.stage, self.sensor = StubStage(self.clock), Sensor(self.clock)
        frame = self.settings.frame
        self.stage.at_mm = [frame.pad_centre_x_mm, frame.pad_y_mm, frame.apex_z_mm + above_mm]
        self.stage.homed = True
        self.speeds_mm_s: list[float] = []
        jog = self.stage.jog

        def jogs(axis: str, mm: float, speed_mm_s: float) -> None:
            self.speeds_mm_s.append(speed_mm_s)
            jog(axis, mm, speed_mm_s)

        self.stage.jog = jogs  # type: ignore[method-assign]
        self.sensor.felt = self.law
        self.sensing = Sensing(self.settings, self.clock, self.sensor)
        self.sensing.zero = zero
        self.guard = Guard(self.settings, self.sensing) if guarded else None
        self.shown: list[tuple[StageStatus, float | None]] = []
        self.kept: list[KnownContact] = []
        self.hand = ByHand(
            self.settings,
            self.stage,
            self.clock,
            self.guard,
            lambda at, gwt: self.shown.append((at, gwt)),
            placed=placed,
        )  # type: ignore[arg-type]
        self.hand.may_touch, self.hand.keep_contact = may_touch, self.kept.append

    def law(self) -> float:
        return float(6.0 * max(-self.height_mm, 0.0) ** 1.5)

    @property
    def height_mm(self) -> float:
        return self.stage.at_mm[2] - self.settings.frame.apex_z_mm

    @property
    def x_mm(self) -> float:
        return self.stage.at_mm[0] - self.settings.frame.pad_centre_x_mm

    def jog(self, axis: Any, by_mm: float, speed_mm_s: float = 2.0) -> Moved:
        way = Direction(axis, 1 if by_mm > 0 else -1)
        return self.hand.go(lambda: way, speed_mm_s, abs(by_mm))

    @property
    def steps_mm(self) -> list[float]:
        """What the stage was told to jog along z."""
        return [told[2] for told in self.stage.told if told[:2] == ("jog", "z")]


# --- down ---


@pytest.mark.parametrize(
    ("room_mm", "steps_mm", "code"),
    [(0.02, [0.02, 0.02, 0.01], None), (0.0026, [0.0026] * 3, None), (0.0024, [], "next_step_past_soft_trip")],
)
def test_a_step_down_is_no_longer_than_the_room_that_is_left(
    monkeypatch: pytest.MonkeyPatch, room_mm: float, steps_mm: list[float], code: str | None
) -> None:
    """And none is made where that is less than a step of the stage, 0.0025 mm."""
    bench = Hand(1.0)
    monkeypatch.setattr(Guard, "room_mm", property(lambda guard: room_mm))
    problem = bench.jog("z", -sum(steps_mm or [0.05]), 2.0).problem
    assert bench.steps_mm == pytest.approx([-mm for mm in steps_mm], abs=1e-4)
    assert (None if problem is None else problem.code) == code


def test_what_is_felt_after_it_came_to_rest_is_told_and_lifted_from() -> None:
    """A touch ends the motion, and at rest the force is above the trip."""
    bench = Hand(0.5, soft_trip_n=0.1)
    touched: list[bool] = []

    def felt() -> float:
        if bench.height_mm >= -0.06:
            return 0.0
        touched.append(True)
        return 1.0 if len(touched) == 1 else 20.0

    bench.sensor.felt = felt
    problem = bench.jog("z", -1.0).problem
    assert problem is not None
    assert problem.code == "touched"
    assert "; then force 20.00 gwt exceeds the soft trip of" in str(problem)
    assert printed(problem, "lifted by ", " mm") == pytest.approx(0.6, abs=0.06)
    assert bench.height_mm == pytest.approx(0.5, abs=1e-3)


# --- sideways and up ---


@pytest.mark.parametrize(
    ("above_mm", "placed", "top_mm", "lifted_mm"),
    [(3.0, True, 4.5, 2.0), (3.0, True, 5.5, 4.0), (3.0, True, 99.0, 7.0), (0.5, True, 2.4, 2.0),
     (3.0, False, 5.5, 4.0), (3.0, False, 99.0, 8.0)],
)  # fmt: skip
def test_a_touch_sideways_lifts_by_clearances_until_the_force_vanishes(
    above_mm: float, placed: bool, top_mm: float, lifted_mm: float
) -> None:
    """Up to the park height, 10 mm; an unknown height counts as clearance, 2 mm."""
    bench = Hand(above_mm, placed=placed, soft_trip_n=0.1)
    bench.sensor.felt = lambda: 30.0 if bench.x_mm > 1.0 and bench.height_mm < top_mm else 0.0
    moved = bench.jog("x", 4.0)
    assert moved.problem is not None
    assert moved.problem.code == "soft_trip"
    assert f"lifted by {lifted_mm:.2f} mm" in str(moved.problem)
    assert 1.0 < bench.x_mm < 1.7
    assert bench.height_mm == pytest.approx(above_mm + lifted_mm)
    assert moved.at == bench.stage.status()
    last = bench.kept[-1]
    free, touched = ("lifted", "disagreement") if placed else ("unknown", "touching")
    assert (bench.kept[0].force_gwt, last.kind) == (30.0, free if top_mm < 99 else touched)
    assert bench.hand.may_touch is (last.kind != "lifted")


def test_a_touch_that_has_vanished_at_rest_lifts_nothing() -> None:
    """As from a vibration of the stage: the motion ends, and there is nothing to lift off."""
    bench = Hand(3.0)
    once = iter([0.06])
    bench.sensor.felt = lambda: next(once, 0.0) if bench.x_mm > 1.0 else 0.0
    problem = bench.jog("x", 4.0).problem
    assert problem is not None
    assert (problem.code, "lifted" in str(problem), bench.height_mm) == ("touched", False, 3.0)


def test_a_touch_sideways_counts_from_the_zero_too() -> None:
    """0.04 gwt before the motion and 0.06 in it: 0.02 gwt more, but a touch."""
    bench = Hand(3.0)
    bench.sensor.felt = lambda: 0.06 if bench.x_mm > 1.0 else 0.04
    problem = bench.jog("x", 4.0).problem
    assert problem is not None
    assert (problem.code, bench.x_mm < 1.7) == ("touched", True)


@pytest.mark.parametrize(("soft_trip_n", "speed_mm_s"), [(0.05, 0.47), (0.16, 1.045), (2.0, 5.0)])
def test_sideways_is_as_slow_as_a_touch_below_half_the_trip_needs(soft_trip_n: float, speed_mm_s: float) -> None:
    bench = Hand(3.0, soft_trip_n=soft_trip_n)
    bench.jog("x", 0.5, 10.0)
    assert bench.speeds_mm_s[0] == pytest.approx(speed_mm_s, abs=0.001)
    unguarded = Hand(3.0, guarded=False, soft_trip_n=soft_trip_n)
    unguarded.jog("x", 0.5, 10.0)
    assert unguarded.speeds_mm_s[0] == 10.0


def test_a_late_reading_halts_it_and_it_goes_on_with_the_next_one() -> None:
    """Two slices of 0.1 s are under way at most, as long as a reading of this sensor may be late."""
    bench = Hand(3.0)
    late: list[float] = []

    def felt() -> float:
        if not late and bench.x_mm > 0.5:
            late.append(bench.x_mm)
            bench.clock.wait_s(3.0)
            late.append(bench.x_mm)
        return 0.0

    bench.sensor.felt = felt
    moved = bench.jog("x", 2.0)
    assert late[1] - late[0] <= 2.0 * 0.2 + 1e-6
    assert moved.at.x_mm - bench.settings.frame.pad_centre_x_mm <= 2.0 + 1e-6


@pytest.mark.parametrize(
    ("above_mm", "options", "shows_gwt", "known"),
    [
        (3.0, {}, 0.04, ("lifted", 0.04)),
        (3.0, {}, 0.06, ("disagreement", 0.06)),
        (3.0, {}, -0.06, ("disagreement", -0.06)),
        (0.5, {}, 0.04, ("unknown", 0.04)),
        (0.5, {}, 0.06, ("touching", 0.06)),
        (3.0, {"zero": None}, 0.04, ("raised", None)),
        (3.0, {"guarded": False}, 0.04, ("raised", None)),
        (0.5, {"guarded": False}, 0.04, ("unknown", None)),
        (3.0, {"placed": False}, 0.04, ("unknown", 0.04)),
    ],
)
def test_after_each_motion_the_state_of_contact_is_on_record(
    above_mm: float, options: dict[str, Any], shows_gwt: float, known: tuple[str, float | None]
) -> None:
    """Where a touch was possible."""
    bench = Hand(above_mm, may_touch=True, **options)
    bench.sensor.felt = lambda: shows_gwt
    bench.jog("z", 0.01)
    found = bench.kept[-1]
    assert (found.kind, found.force_gwt) == (known[0], known[1] if known[1] is None else pytest.approx(known[1]))
    placed = options.get("placed", True)
    assert (found.x_mm, found.height_mm) == ((0.0, pytest.approx(above_mm + 0.01)) if placed else (None, None))
    other = Hand(3.0)
    other.jog("z", 0.01)
    assert other.kept == []


def test_from_a_touch_up_goes_in_slices_until_lifted_and_then_in_one_motion() -> None:
    """Slices of 0.2 s from rest, none ahead; above clearance, once nothing is felt, two slices of 0.1 s ahead."""
    bench = Hand(1.5, may_touch=True)
    assert bench.jog("z", 1.6, 1.0).at == bench.stage.status()
    assert bench.steps_mm[:3] == pytest.approx([0.2, 0.2, 0.2])
    assert bench.steps_mm[3:] == pytest.approx([0.1] * 10)
    felt = Hand(1.5, may_touch=True)
    felt.sensor.felt = lambda: 0.06
    assert felt.jog("z", 1.6, 1.0).at == felt.stage.status()
    assert set(felt.speeds_mm_s) == {1.0}
    assert felt.steps_mm == pytest.approx([0.2] * 8)


@pytest.mark.parametrize("then", [None, DOWN, RIGHT], ids=["let go", "down", "aside"])
@pytest.mark.parametrize("first", [UP, DOWN, LEFT], ids=["up", "down", "left"])
@pytest.mark.parametrize("may_touch", [False, True])
def test_another_direction_ends_a_motion(first: Direction, then: Direction | None, may_touch: bool) -> None:
    """Whenever it is held: at each question, the person may have changed the key."""
    for times in range(1, 40):
        bench = Hand(2.2, may_touch=may_touch)
        asked = [0]

        def held(asked: list[int] = asked, times: int = times) -> Direction | None:
            asked[0] += 1
            return first if asked[0] <= times else then

        bench.hand.go(held, 2.0, 1.0)
        moved = {told[1:] for told in bench.stage.told if told[0] == "jog"}
        assert all(axis == first.axis and mm * first.sign > 0 for axis, mm in moved), times
        if asked[0] <= times:
            return


# --- what is on record ---


def test_a_new_hand_relies_on_no_lift_of_another_process() -> None:
    bench = Hand()
    hand = ByHand(bench.settings, bench.stage, bench.clock, bench.guard, lambda *_: None, placed=True)  # type: ignore[arg-type]
    assert hand.may_touch is True
    hand.may_touch = False
    for placed, may_touch in ((True, False), (False, True), (True, True)):
        hand.set_placed(placed=placed)
        assert (hand.placed, hand.may_touch) == (placed, may_touch)
    other = Hand(placed=False).hand
    other.set_placed(placed=False)
    assert other.may_touch is False


@pytest.mark.parametrize(
    ("by_mm", "options", "kept"),
    [
        (0.5, {}, []),
        (1.0, {}, []),
        (1.015, {}, []),
        (1.03, {}, ["unknown", "unknown"]),
        (0.1, {"placed": False}, ["unknown", "unknown"]),
        (0.1, {"may_touch": True}, ["lifted"]),
        (1.1, {"may_touch": True}, ["unknown", "unknown"]),
        (None, {}, ["unknown", "lifted"]),
    ],
)
def test_down_to_clearance_no_touch_is_possible(
    by_mm: float | None, options: dict[str, Any], kept: list[str]
) -> None:
    """From 3 mm; with a key it may go on below clearance. A doubt is on record before the motion."""
    bench = Hand(3.0, **options)
    until_s = bench.clock.monotonic_s() + 0.2
    by_key = lambda: DOWN if bench.clock.monotonic_s() < until_s else None  # noqa: E731
    bench.hand.go((lambda: DOWN) if by_mm is not None else by_key, 2.0, by_mm)
    assert [one.kind for one in bench.kept] == kept
    if kept[:1] == ["unknown"] and not options.get("may_touch"):
        assert bench.kept[0].height_mm == (3.0 if options.get("placed", True) else None)


def test_at_clearance_the_force_is_measured_at_rest_and_below_it_is_read_once() -> None:
    """A touch that a slow cell still shows vanishes; below clearance the finger itself may be felt."""
    bench = Hand(2.5, may_touch=True)
    until_s = bench.clock.monotonic_s() + 1.0
    bench.sensor.felt = lambda: 0.06 if bench.clock.monotonic_s() < until_s else 0.0
    bench.jog("z", 0.01)
    assert (bench.kept[-1].kind, bench.kept[-1].force_gwt) == ("lifted", 0.0)
    assert bench.clock.monotonic_s() > until_s
    as_long = Hand(0.5, may_touch=True)
    as_long.jog("z", 0.01)
    below = Hand(0.5, may_touch=True)
    begun_s = below.clock.monotonic_s()
    below.sensor.felt = lambda: 3.0 if len(below.shown) >= len(as_long.shown) else 0.04  # once it is at rest again
    below.jog("z", 0.01)
    assert (below.kept[-1].kind, below.kept[-1].force_gwt) == ("touching", pytest.approx(3.0))
    assert below.clock.monotonic_s() - begun_s < 0.5


# --- what may go wrong ---


def test_a_stage_that_fails_at_the_end_leaves_the_record_in_doubt() -> None:
    bench = Hand(2.5)
    status = bench.stage.status

    def fails() -> StageStatus:
        if bench.height_mm < 1.9:
            raise StageError("no answer")
        return status()

    bench.stage.status = fails  # type: ignore[method-assign]
    with pytest.raises(StageError):
        bench.jog("z", -1.0)
    assert [one.kind for one in bench.kept] == ["unknown"]
    assert bench.hand.may_touch
