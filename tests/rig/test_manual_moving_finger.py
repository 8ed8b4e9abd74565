"""A finger that comes up under manual control: it is not dragged, and no command says that it is not touched.

On every stage, devices virtual, bytes real. The finger is a spring F = 6 d^1.5; clearance is 2 mm, the soft trip
16.3 gwt. The way in contact is the lateral way during which the true force is above 0, sampled every 2 ms.
"""

import math
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any

import pytest

from rig.bench import checks
from rig.engine.contact import KnownContact
from rig.engine.limits import FingerStiffness, TouchLimit, Trips
from rig.engine.sensing import ForceZero
from rig.errors import LimitError
from rig.plan.config import Config
from sim.carriage import Carriage
from tests.error_codes import raises
from tests.rig.hand_bench import KINDS, STAGES, HandBench, Person, SessionBench, Spring, code_of_end

ZERO, TRIP_N, CLEARANCE_MM, TOUCH_GWT = ForceZero(0.0, 0.0), 0.16, 2.0, 0.05
AXES = [*((kind, "x") for kind in STAGES), ("grbl", "y")]
"""Only one of the stages moves along the finger."""
UPS_MM, AFTER_S = (2.3, 3.0, 4.0), (0.3, 1.7, 2.9)
RISES_MM_S, LATE_S = 20.0, 0.25  # how fast the finger moves; a sample of the sensor and its reply


class Finger(Spring):
    """A finger that comes up by so much between two instants, and a second one beside it, up to 5 mm high."""

    up_mm, from_s, until_s = 0.0, 0.0, math.inf
    beside: tuple[str, float] | None = None

    def __init__(self, carriage: Carriage, k_gwt: float, skin_mm: float = 0.0) -> None:
        super().__init__(carriage, k_gwt, skin_mm)
        self.dragged_mm, self._last_mm = 0.0, (math.nan, math.nan)

    def come_up(self, mm: float, from_s: float, for_s: float = math.inf) -> None:
        self.up_mm, self.from_s, self.until_s = mm, from_s, from_s + for_s

    def skin_at_mm(self, t_s: float) -> float:
        risen_mm = min(max(t_s - self.from_s, 0.0) * RISES_MM_S, self.up_mm)
        return self.skin_mm + max(risen_mm - max(t_s - self.until_s, 0.0) * RISES_MM_S, 0.0)

    def true_gwt(self, t_s: float) -> float:
        pose, beside_mm = self.carriage.pose_at(t_s), 0.0
        if self.beside is not None and pose.above_apex_mm < 5.0:
            axis, at_mm = self.beside
            beside_mm = max((pose.x_mm if axis == "x" else pose.along_mm) - at_mm, 0.0)
        return super().true_gwt(t_s) + float(self.k_gwt * beside_mm**1.5)

    def next_look_s(self, t_s: float) -> float:
        """Called with each sample, in turn."""
        pose = self.carriage.pose_at(t_s)
        if self.true_gwt(t_s) > 0 and not math.isnan(self._last_mm[0]):
            self.dragged_mm += abs(pose.x_mm - self._last_mm[0]) + abs(pose.along_mm - self._last_mm[1])
        self._last_mm = pose.x_mm, pose.along_mm
        return 0.002


def in_square(*at: int) -> bool:
    """Return whether a row belongs to the third of a table that has every pair of values."""
    return sum(at) % 3 == 0


def limit_mm(bench: SessionBench) -> float:
    """Longest way in contact, as documented, from where this softer finger reaches the touch threshold."""
    trip_gwt, unknown = Trips(bench.config.limits, None).lowest_gwt, FingerStiffness.unknown()
    documented_mm = TouchLimit.of(bench.config, trip_gwt, TOUCH_GWT, unknown).in_contact_mm
    return documented_mm - unknown.depth_mm(TOUCH_GWT) + FingerStiffness(6.0).depth_mm(TOUCH_GWT)


def at_clearance(kind: str, *, known: bool = True) -> tuple[SessionBench, Finger]:
    bench = SessionBench(kind, above_mm=CLEARANCE_MM, zero=ZERO, spring=Finger, soft_trip_n=TRIP_N, known=known)
    assert isinstance(bench.spring, Finger)
    bench.step("z", 0.01)
    assert bench.session.contact().known.kind == ("lifted" if known else "unknown")
    return bench, bench.spring


@pytest.mark.quick(rows=lambda kind, axis, up_mm: in_square([*STAGES].index(kind), UPS_MM.index(up_mm)))
@pytest.mark.parametrize(("kind", "axis"), AXES)
@pytest.mark.parametrize("up_mm", UPS_MM)
def test_no_step_sideways_begins_on_a_finger_that_came_up_after_the_lift(kind: str, axis: str, up_mm: float) -> None:
    bench, finger = at_clearance(kind)
    finger.come_up(up_mm, bench.clock.monotonic_s())
    bench.clock.wait_s(1.0)
    with raises(LimitError, "touches_still" if up_mm < 4.0 else "soft_trip"):
        bench.step(axis, 5.0)
    assert finger.dragged_mm == 0.0
    assert bench.session.contact().known.kind == "disagreement"
    assert bench.step("z", 3.0).ended_by is None
    assert bench.session.contact().known.kind == "lifted"


@pytest.mark.quick(
    rows=lambda kind, axis, up_mm, for_s, after_s, known: (
        in_square([*STAGES].index(kind), UPS_MM.index(up_mm), AFTER_S.index(after_s))
        and (for_s == math.inf) is (UPS_MM.index(up_mm) != 1)
    )
)
@pytest.mark.parametrize(("kind", "axis"), AXES)
@pytest.mark.parametrize("up_mm", UPS_MM)
@pytest.mark.parametrize("for_s", [0.3, math.inf], ids=["pulse", "stays"])
@pytest.mark.parametrize("after_s", AFTER_S)
@pytest.mark.parametrize("known", [True, False], ids=["height known", "height unknown"])
def test_a_finger_that_comes_up_during_a_step_sideways_ends_the_step_and_is_lifted_off(
    kind: str, axis: str, up_mm: float, for_s: float, after_s: float, known: bool
) -> None:
    """In the measurement before it, or under way."""
    bench, finger = at_clearance(kind, known=known)
    finger.come_up(up_mm, bench.clock.monotonic_s() + after_s, for_s)
    ended: str | None = None
    with suppress(LimitError):  # It came up before the motion.
        ended = code_of_end(bench.step(axis, 5.0, 5.0))
    assert finger.dragged_mm <= limit_mm(bench)
    assert bench.worst_gwt <= 6.0 * (up_mm - CLEARANCE_MM) ** 1.5 + 1e-6, "the finger's own force, and no more"
    found = bench.session.contact().known
    assert found.may_touch or finger.true_gwt(bench.clock.monotonic_s()) < TOUCH_GWT
    assert ended in (None, "touched", "touch_at_clearance", "soft_trip", "hard_trip", "late_reading")
    assert not (known and ended in ("touched", "touch_at_clearance") and finger.true_gwt(bench.clock.monotonic_s()))


@pytest.mark.quick(rows=lambda kind, axis, speed_mm_s, at_mm, known: (at_mm == 1.5) is (speed_mm_s == 10.0))
@pytest.mark.parametrize(("kind", "axis"), AXES)
@pytest.mark.parametrize("speed_mm_s", [0.5, 10.0])
@pytest.mark.parametrize("at_mm", [1.5, 1.574])
@pytest.mark.parametrize("known", [True, False], ids=["height known", "height unknown"])
def test_a_second_finger_beside_the_first_ends_a_step_sideways(
    kind: str, axis: str, speed_mm_s: float, at_mm: float, known: bool
) -> None:
    bench, finger = at_clearance(kind, known=known)
    finger.beside = (axis, at_mm)
    found = bench.step(axis, 5.0, speed_mm_s)
    assert code_of_end(found) in ("touched", "touch_at_clearance")
    assert finger.dragged_mm <= limit_mm(bench)
    assert bench.worst_gwt <= Trips(bench.config.limits, None).lowest_gwt / 2
    assert finger.true_gwt(bench.clock.monotonic_s()) == 0.0
    assert bench.height_mm >= 5.0 - 0.01
    assert found.known.kind == ("lifted" if known else "unknown")


# --- what is said of it ---


@pytest.mark.quick(rows=lambda kind, up_mm: in_square([*STAGES].index(kind), UPS_MM.index(up_mm)))
@pytest.mark.parametrize("kind", STAGES)
@pytest.mark.parametrize("up_mm", UPS_MM)
def test_the_panel_says_lifted_only_while_the_sensor_reads_no_force(kind: str, up_mm: float) -> None:
    """Also in a motion and in a zero; no longer than a sample is under way."""
    bench = HandBench(kind, above_mm=CLEARANCE_MM, zero=ZERO, lifted=True, spring=Finger, soft_trip_n=TRIP_N)
    finger, said = bench.spring, list[str]()
    assert isinstance(finger, Finger)

    def look() -> None:
        known = bench("status")["contact"]
        said.append(known["contact"])
        now_s = bench.clock.monotonic_s()
        touched = all(finger.true_gwt(now_s - ago_s) >= TOUCH_GWT for ago_s in (0.0, LATE_S / 2, LATE_S))
        assert known["may_touch"] or not touched

    def person() -> Person:
        for do in (lambda: iter([]), lambda: bench.step("x", -1.0), lambda: bench.do("zero")):
            for _ in range(10):
                look()
                yield 0.1
            finger.come_up(up_mm, bench.clock.monotonic_s() + 0.5, 1.5)
            doing: Iterator[float] = do()
            for _ in range(60):
                yield next(doing, 0.1)
                look()

    bench.run(person())
    assert {"lifted", "disagreement"} <= set(said)


@pytest.fixture
def looked_at(monkeypatch: pytest.MonkeyPatch) -> Callable[[HandBench], None]:
    """Commands that look at the devices find those of a bench."""

    def look_at(bench: HandBench) -> None:
        monkeypatch.setattr(bench.bench.stage, "close", lambda: None, raising=False)
        monkeypatch.setattr(checks, "open_stage", lambda settings, clock: bench.bench.stage)
        monkeypatch.setattr(bench.bench.force, "close", lambda: None)
        monkeypatch.setattr(checks, "open_force", lambda settings, clock: bench.bench.force)
        monkeypatch.setattr(checks, "WallClock", lambda: bench.clock)

    return look_at


def status(bench: HandBench) -> dict[str, Any]:
    return dict(checks.look_and_contact(bench.config)["contact"])


def doctor(bench: HandBench) -> dict[str, Any]:
    return dict(checks.look_and_contact(bench.config, closely=True)["contact"])


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("command", [status, doctor])
@pytest.mark.parametrize(("up_mm", "contact"), [(0.0, "lifted"), (2.3, "disagreement")])
def test_status_and_doctor_measure_contact_now(
    kind: str, command: Callable[[HandBench], dict[str, Any]], up_mm: float, contact: str,
    looked_at: Callable[[HandBench], None],
) -> None:  # fmt: skip
    bench = HandBench(kind, above_mm=CLEARANCE_MM, zero=ZERO, lifted=True, spring=Finger)
    bench.bench.force.connect()
    looked_at(bench)
    bench.spring.skin_mm = up_mm
    said = command(bench)
    assert (said["contact"], said["may_touch"]) == (contact, contact != "lifted")
    assert said["force_gwt"] == pytest.approx(6.0 * max(up_mm - CLEARANCE_MM, 0.0) ** 1.5, abs=0.02)
    assert said["measured_unix_s"] == pytest.approx(bench.clock.unix_s(), abs=1.0)
    known = bench.memory.read().contact
    assert known is not None
    assert known.kind == "lifted", "looking on leaves the record"


@pytest.mark.parametrize("why", ["moved since", "no zero", "another sensor", "no force", "owned"])
def test_status_without_a_measurement_states_when_contact_was_last_measured(
    why: str, looked_at: Callable[[HandBench], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = HandBench("grbl", above_mm=CLEARANCE_MM, zero=None if why == "no zero" else ZERO, lifted=True)
    bench.memory.touched(KnownContact("lifted", 0.0, 0.0, 2.0, 1.7e9))
    bench.bench.force.connect()
    looked_at(bench)
    bench.spring.skin_mm = 4.0
    config: Config = bench.config
    if why == "moved since":
        bench.bench.stage.move_to(z_mm=config.frame.apex_z_mm + 2.1, speed_mm_s=5)
    if why == "another sensor":
        other = config.force.model_copy(update={"sample_period_s": 0.06})
        config = config.model_copy(update={"force": other})
    if why == "no force":
        monkeypatch.setattr(bench.bench.force, "read", lambda: (_ for _ in ()).throw(checks.ForceError("no answer")))
    if why == "owned":
        monkeypatch.setattr(checks, "first_owner", lambda ports: checks.PortOwner(None))
    said = checks.look_and_contact(config)["contact"]
    assert (said["contact"], said["may_touch"]) == ("unknown" if why in ("moved since", "owned") else "raised", True)
    assert said["measured_unix_s"] == 1.7e9
    assert "last measured at 20" in said["where_text"]
    assert "0.00 gwt, and unknown since because a finger moves" in said["where_text"]


# --- zero ---


@pytest.mark.quick(
    rows=lambda kind, up_mm, at_s: (
        in_square([*STAGES].index(kind), UPS_MM.index(up_mm), round(at_s / 0.15)) and (kind in KINDS or up_mm == 3.0)
    )
)
@pytest.mark.parametrize("kind", STAGES)
@pytest.mark.parametrize("up_mm", UPS_MM)
@pytest.mark.parametrize("at_s", [0.0, 0.15, 0.3, 0.45, 0.6, 0.75, 0.9])
def test_a_zero_during_which_a_finger_comes_up_never_hides_a_touch(kind: str, up_mm: float, at_s: float) -> None:
    """It came up before, at any instant of it, or in the lift; what is then zero is less than a touch."""
    bench = HandBench(kind, above_mm=CLEARANCE_MM, spring=Finger)
    finger = bench.spring
    assert isinstance(finger, Finger)

    def person() -> Person:
        yield 0.5
        finger.come_up(up_mm, bench.clock.monotonic_s() + at_s)
        yield from bench.do("zero")

    found = bench.run(person())
    zero = bench.memory.read().zero
    if found["ended_by"] is None:
        assert zero is not None
        assert abs(zero.offset_n / 0.00980665) < TOUCH_GWT
    else:
        assert zero is None
        assert "zero again" in found["ended_by"] or "drift" in found["ended_by"]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("placed", [True, False])
def test_a_zero_lifts_the_indentor_by_three_tenths_of_a_millimeter_and_leaves_it_there(
    kind: str, placed: bool
) -> None:
    bench = HandBench(kind, above_mm=CLEARANCE_MM, known=placed)
    found = bench.run(bench.do("zero"))
    assert (found["ended_by"], found["zeroed"], found["homed"]) == (None, True, placed)
    assert bench.height_mm == pytest.approx(CLEARANCE_MM + 0.3, abs=0.004)
    left_mm = bench.memory.read().left_at_mm
    assert (left_mm is not None) is placed
    known = bench.memory.read().contact
    assert known is not None
    assert known.kind == ("lifted" if placed else "unknown")


@pytest.mark.parametrize("kind", KINDS)
def test_a_zero_at_the_top_of_the_travel_moves_down_first(kind: str) -> None:
    bench = HandBench(kind, above_mm=CLEARANCE_MM)

    def person() -> Person:
        yield from bench.do("home")
        top_mm.append(bench.height_mm)
        yield from bench.do("zero")

    top_mm = list[float]()
    found = bench.run(person())
    assert (found["ended_by"], found["zeroed"], found["homed"]) == (None, True, True)
    assert top_mm[0] - 0.03 <= bench.height_mm <= top_mm[0] + 0.31


def test_a_zero_with_anyway_moves_nothing_and_refuses_scattered_readings() -> None:
    bench = HandBench("grbl", above_mm=CLEARANCE_MM, zero=ZERO, spring=Finger)
    bench.spring.skin_mm, finger = 2.3, bench.spring
    assert isinstance(finger, Finger)

    def person() -> Person:
        yield from bench.do("zero", anyway=True)
        assert bench("status")["ended_by"] is None
        finger.come_up(1.0, bench.clock.monotonic_s() + 0.3)
        yield from bench.do("zero", anyway=True)

    found = bench.run(person())
    assert "scatter by" in found["ended_by"]
    assert (bench.height_mm, bench.memory.read().zero) == (pytest.approx(CLEARANCE_MM, abs=0.004), None)
