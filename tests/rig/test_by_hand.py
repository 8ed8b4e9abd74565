"""Motions by hand read the force: what each may do to a finger, on every stage. Bench virtual, bytes real.

The finger is a spring F = k d^1.5 below its skin; the truth is sampled every 2 ms.
"""

import io
import itertools
import json
import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from rig.bench.virtual import bench_around
from rig.devices.base import ForceBusy, ForceReading, StageOverridden, StageStatus
from rig.engine.contact import KnownContact
from rig.engine.dead_man import Direction, dead_man_jog
from rig.engine.sensing import ForceZero, NoReadingError, Sensing
from rig.errors import LimitError
from rig.manual.guard import Guard
from rig.manual.jog import ByHand, Moved
from rig.plan.config import Config
from rig.units import GWT_N
from sim.carriage import Carriage
from sim.devices.clock import VirtualClock
from tests.error_codes import causes, has_code, printed, raises
from tests.rig.hand_bench import APEX_MM, KINDS, STAGES, Spring

TOUCH_GWT = Config().habits.touch_force_gwt
INCREMENT_MM = Config().habits.increment_mm
# One increment of the stage, and what the stage and the noise of a settled reading may add.
SPRINGS = {"finger": 6.0, "ten times": 60.0, "a block": 6000.0}


class AtHand:
    """A homed stage over a spring, some way above it, and its force as a person's motions are told of it."""

    def __init__(
        self,
        kind: str,
        *,
        k_gwt: float = 6.0,
        skin_mm: float = 0.0,
        above_mm: float = 3.0,
        placed: bool = True,
        felt: bool = True,
        zero: ForceZero | None = None,
        spring: type[Spring] = Spring,
        **limits: Any,
    ) -> None:
        self.config = Config.model_validate({**STAGES[kind], "limits": limits})
        springs: list[Spring] = []

        def make(carriage: Carriage) -> Spring:
            springs.append(spring(carriage, k_gwt, skin_mm))
            return springs[0]

        self.clock, self.wire = VirtualClock(1.7e9), io.StringIO()
        self.bench = bench_around(make, self.config, self.clock, self.wire)
        self.spring, self.worst_gwt = springs[0], 0.0
        self.bench.stage.connect()
        self.bench.stage.home()
        self.bench.stage.move_to(x_mm=self.config.frame.pad_centre_x_mm, speed_mm_s=10)
        self.bench.stage.move_to(z_mm=APEX_MM + above_mm, speed_mm_s=10)
        self.bench.force.connect()
        self.sensing = Sensing(self.config, self.clock, self.bench.force)
        self.sensing.zero = zero
        guard = Guard(self.config, self.sensing) if felt else None
        self.shown: list[tuple[StageStatus, float | None]] = []
        self.hand = ByHand(self.config, self.bench.stage, self.clock, guard, self._show, placed=placed)
        self._sample()

    def _show(self, at: StageStatus, force_gwt: float | None) -> None:
        self.shown.append((at, force_gwt))

    def _sample(self) -> None:
        now_s = self.clock.monotonic_s()
        self.worst_gwt = max(self.worst_gwt, self.spring.true_gwt(now_s))
        self.clock.call_at(now_s + self.spring.next_look_s(now_s), self._sample)

    def jog(self, axis: Any, by_mm: float, speed_mm_s: float = 2.0) -> Moved:
        direction = Direction(axis, 1 if by_mm > 0 else -1)
        return self.hand.go(lambda: direction, speed_mm_s, abs(by_mm))

    @property
    def height_mm(self) -> float:
        return self.spring.carriage.pose_at(self.clock.monotonic_s()).above_apex_mm

    @property
    def x_mm(self) -> float:
        return self.spring.pose_at(self.clock.monotonic_s()).x_mm

    @property
    def written(self) -> int:
        """How much was sent to the stage."""
        return sum('"stage"' in line and '"tx"' in line for line in self.wire.getvalue().splitlines())

    def one_increment_gwt(self, from_gwt: float) -> float:
        """What the spring adds over one increment from a force, with two readings' rounding."""
        depth_mm = (from_gwt / self.spring.k_gwt) ** (2 / 3) + INCREMENT_MM + 0.003
        return float(self.spring.k_gwt * depth_mm**1.5)


def codes(moved: Moved) -> list[str]:
    """Of what ended a motion, and of what was felt after it."""
    if moved.problem is None:
        return []
    return [moved.problem.code, *(["soft_trip"] if "; then force" in str(moved.problem) else [])]


@pytest.fixture(params=KINDS)
def at_hand(request: pytest.FixtureRequest) -> Callable[..., AtHand]:
    return lambda **options: AtHand(request.param, **options)


# --- down ---


@pytest.mark.quick(rows=lambda at_hand, k_gwt, placed: at_hand == "grbl" or k_gwt == 6.0)
@pytest.mark.parametrize("k_gwt", SPRINGS.values(), ids=SPRINGS)
@pytest.mark.parametrize("placed", [True, False], ids=["height known", "height unknown"])
def test_down_ends_at_the_first_touch(at_hand: Callable[..., AtHand], k_gwt: float, placed: bool) -> None:
    """Within one increment of it, however stiff what lies there."""
    bench = at_hand(k_gwt=k_gwt, placed=placed, above_mm=1.0)
    moved = bench.jog("z", -2.4, 5.0)
    assert codes(moved)[0] in ("touched", "soft_trip", "hard_trip", "next_step_past_soft_trip")
    assert bench.worst_gwt <= bench.one_increment_gwt(TOUCH_GWT)


def test_from_above_clearance_a_finger_that_lies_higher_is_met_by_one_step(at_hand: Callable[..., AtHand]) -> None:
    """frame.apex_z_mm is 4 mm too low: down it is read every habits.descent_step_mm, 0.5 mm, 2 gwt on a finger."""
    bench = at_hand(skin_mm=4.0, above_mm=8.0)
    moved = bench.jog("z", -7.0, 10.0)
    assert codes(moved)[0] == "touched"
    assert bench.worst_gwt <= 6.0 * 0.51**1.5


def test_a_new_motion_goes_on_and_never_passes_the_soft_trip(at_hand: Callable[..., AtHand]) -> None:
    """0.05 N, 5.1 gwt; a jog used to press to 0.17 N."""
    bench = at_hand(soft_trip_n=0.05, above_mm=0.2, placed=False)
    ended = [codes(bench.jog("z", -1.2))[0] for _ in range(4)]
    assert ended == ["touched", *["next_step_past_soft_trip"] * 3]
    assert 3.0 < bench.worst_gwt < 0.05 / GWT_N


def test_too_deep_in_the_known_finger_is_refused_before_anything_moves(at_hand: Callable[..., AtHand]) -> None:
    bench = at_hand(above_mm=3.0)
    written, at_mm = bench.written, bench.height_mm
    with raises(LimitError, "too_deep", depth_mm=pytest.approx(17.0, abs=0.005), limit_mm=1.5):
        bench.jog("z", -20.0)
    assert bench.height_mm == at_mm
    assert bench.written - written <= 4, "only asked where it is"


def test_with_a_key_held_a_dead_sensor_is_stopped_by_depth(at_hand: Callable[..., AtHand]) -> None:
    """Frozen at 0 from the beginning no sensor can show; the known height can."""
    bench = at_hand(above_mm=0.5)
    freeze(bench, 0.0)
    moved = bench.hand.go(lambda: Direction("z", -1), 2.0)
    assert moved.problem is not None
    has_code(moved.problem, "too_deep", depth_mm=pytest.approx(1.525, abs=0.03), limit_mm=1.5)
    assert bench.height_mm == pytest.approx(-1.5, abs=0.051)


def freeze(bench: AtHand, at_gwt: float | None) -> None:
    """The sensor stays at a value, its own last one if none is given."""
    sensor = bench.sensing.sensor
    last_n = sensor.read().force_n if at_gwt is None else at_gwt * GWT_N

    def read() -> ForceReading:
        bench.clock.wait_s(0.02)
        return ForceReading(last_n, True, bench.clock.monotonic_s())

    sensor.read = read  # type: ignore[method-assign]


@pytest.mark.quick(
    rows=lambda at_hand, placed, value_gwt, code, presses: at_hand == "grbl" or (placed and not presses)
)
@pytest.mark.parametrize(("value_gwt", "code"), [(0.0, "lost_finger"), (None, "frozen")], ids=["0", "last"])
@pytest.mark.parametrize("placed", [True, False], ids=["height known", "height unknown"])
@pytest.mark.parametrize("presses", [0, 2])
def test_a_sensor_that_freezes_after_a_touch_is_noticed(
    at_hand: Callable[..., AtHand], placed: bool, value_gwt: float | None, code: str, presses: int
) -> None:
    """0: known to have been touched. At its last value: the finger does not answer for three moves."""
    bench = at_hand(above_mm=0.2, placed=placed)
    assert codes(bench.jog("z", -1.0)) == ["touched"]
    for _ in range(presses):
        bench.jog("z", -0.2)
    before_gwt = bench.worst_gwt
    freeze(bench, value_gwt)
    assert codes(bench.jog("z", -0.9)) == [code]
    depth_mm = (before_gwt / 6.0) ** (2 / 3)
    assert bench.worst_gwt <= 6.0 * (depth_mm + 5 * INCREMENT_MM) ** 1.5


def test_a_reading_that_falls_as_it_goes_down_is_a_sensor_that_reads_backwards(
    at_hand: Callable[..., AtHand],
) -> None:
    bench = at_hand(above_mm=0.2, k_gwt=-6.0)
    assert codes(bench.jog("z", -1.0)) == ["reads_backwards"]


def test_above_a_trip_it_is_lifted_again(at_hand: Callable[..., AtHand]) -> None:
    """A block so stiff that one increment passes the trip: at rest after it, and back the way it came."""
    bench = at_hand(above_mm=0.52, k_gwt=6000.0, soft_trip_n=0.1)
    moved = bench.jog("z", -1.0)
    assert moved.problem is not None
    assert codes(moved)[-1] == "soft_trip"
    reason, _, then = str(moved.problem).partition("; then ")
    assert reason != then.partition(";")[0], "nothing is said twice"
    assert 0.0 < printed(moved.problem, "lifted by ", " mm") < 1.0
    assert bench.spring.true_gwt(bench.clock.monotonic_s()) == 0.0
    assert bench.height_mm == pytest.approx(0.52, abs=0.004)


def test_what_is_still_felt_at_rest_is_not_said_again(at_hand: Callable[..., AtHand]) -> None:
    """A thing that pushes with 30 gwt wherever it is met."""
    bench = at_hand(above_mm=0.52, soft_trip_n=0.1)
    pose_at = bench.spring.pose_at
    bench.spring.true_gwt = lambda t_s: 30.0 * (pose_at(t_s).doi_mm > 0)  # type: ignore[method-assign]
    moved = bench.jog("z", -1.0)
    assert codes(moved) == ["soft_trip"]
    assert moved.problem is not None
    has_code(moved.problem, "soft_trip", force_gwt=pytest.approx(30.0, abs=0.005), limit_gwt=0.1 / GWT_N)
    assert printed(moved.problem, "lifted by ", " mm") > 0


def test_from_a_trip_it_is_lifted_by_clearance_at_most(at_hand: Callable[..., AtHand]) -> None:
    bench = at_hand(above_mm=3.02, k_gwt=6000.0, soft_trip_n=0.1)
    problem = bench.jog("z", -4.0).problem
    assert problem is not None
    assert printed(problem, "lifted by ", " mm") == pytest.approx(2.0, abs=0.005)
    assert bench.height_mm == pytest.approx(2.0, abs=0.06)


@pytest.mark.parametrize(("on_trip", "height_mm"), [("retract", 10.0), ("park", 10.0), ("stop", 3.0)])
def test_a_touch_sideways_lifts_to_the_park_height_while_the_force_remains(
    at_hand: Callable[..., AtHand], on_trip: str, height_mm: float
) -> None:
    """A wall has no end upwards; with limits.on_trip = stop the indentor stays."""
    bench = at_hand(k_gwt=200.0, soft_trip_n=0.02, zero=ForceZero(0.0, 0.0), on_trip=on_trip)
    bench.spring.wall_x_mm = 1.0
    moved = bench.jog("x", 2.0, 5.0)
    assert moved.problem is not None
    assert codes(moved)[0] in ("touched", "soft_trip")
    lifted_mm = printed(moved.problem, "lifted by ", " mm") if "lifted" in str(moved.problem) else 0.0
    assert lifted_mm == pytest.approx(height_mm - 3.0, abs=0.005)
    assert bench.height_mm == pytest.approx(height_mm, abs=0.005)
    assert bench.hand.measured_contact().kind == "disagreement"


def test_the_next_step_down_is_no_longer_than_the_room_that_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = AtHand("grbl", above_mm=1.0)
    monkeypatch.setattr(Guard, "room_mm", property(lambda guard: 0.02))
    steps = list[float]()

    def jog(stage: Any, clock: Any, held: Any, speed_mm_s: float, by_mm: float, *glance: Any) -> StageStatus:
        steps.append(by_mm)
        return dead_man_jog(stage, clock, held, speed_mm_s, by_mm, *glance)

    monkeypatch.setattr("rig.manual.jog.dead_man_jog", jog)
    bench.jog("z", -0.05)
    assert steps == pytest.approx([0.02, 0.02, 0.01])


@pytest.mark.parametrize("times", [1, 2])
def test_a_lift_from_a_trip_whose_speed_somebody_changes_is_made_all_the_same(
    at_hand: Callable[..., AtHand], monkeypatch: pytest.MonkeyPatch, times: int
) -> None:
    """And where it then stands is what is told."""
    bench = at_hand(above_mm=0.52, k_gwt=6000.0, soft_trip_n=0.1)
    lifts: list[float] = []
    halts: list[int] = []

    def jog(
        stage: Any, clock: Any, held: Any, speed_mm_s: float, by_mm: float, *glance: Any, slice_s: float
    ) -> StageStatus:
        if held() == Direction("z", +1):
            lifts.append(by_mm)
            if len(lifts) <= times:
                raise StageOverridden("somebody changed the speed")
        return dead_man_jog(stage, clock, held, speed_mm_s, by_mm, *glance, slice_s=slice_s)

    monkeypatch.setattr("rig.engine.dead_man.dead_man_jog", jog)
    halt = bench.bench.stage.halt
    monkeypatch.setattr(bench.bench.stage, "halt", lambda: (halts.append(1), halt()))
    moved = bench.jog("z", -1.0)
    assert len(halts) == times < len(lifts)
    assert bench.height_mm == pytest.approx(0.52, abs=0.004)
    assert moved.at.z_mm - APEX_MM == pytest.approx(0.52, abs=0.004)


def test_with_on_trip_stop_it_stays(at_hand: Callable[..., AtHand]) -> None:
    bench = at_hand(above_mm=0.52, k_gwt=6000.0, soft_trip_n=0.1, on_trip="stop")
    problem = bench.jog("z", -1.0).problem
    assert problem is not None
    assert "lifted" not in str(problem)
    assert bench.height_mm < 0.0


# --- sideways and up ---


def test_sideways_into_something_it_stops(at_hand: Callable[..., AtHand]) -> None:
    bench = at_hand(zero=ForceZero(0.0, 0.0))
    bench.spring.wall_x_mm = 2.0
    assert codes(bench.jog("x", 6.0, 2.0))[0] == "touched"
    assert 2.0 < bench.x_mm < 2.0 + 2.0 * 0.6


@pytest.mark.parametrize("may_touch", [True, False])
@pytest.mark.parametrize(("zero", "code"), [(ForceZero(0.0, 0.0), "touches_still"), (None, "not_zeroed")])
def test_sideways_is_refused_in_contact_and_without_a_zero(
    at_hand: Callable[..., AtHand], may_touch: bool, zero: ForceZero | None, code: str
) -> None:
    """As after a jog up that the motor did not follow, or a finger that came up: 0.1 mm in a spring, 0.19 gwt."""
    bench = at_hand(above_mm=-0.1, zero=zero)
    bench.hand.may_touch = may_touch
    from_mm = bench.x_mm
    with raises(LimitError, code):
        bench.jog("x", 1.0)
    assert bench.x_mm == from_mm
    assert bench.jog("z", 2.0).ended_by is None


def test_up_is_always_free(at_hand: Callable[..., AtHand]) -> None:
    """Above the trip only up; there no force that falls stops it."""
    bench = at_hand(above_mm=-0.8, soft_trip_n=0.02, zero=ForceZero(0.0, 0.0))
    for axis, by_mm in (("x", 1.0), ("z", -0.1)):
        with raises(LimitError, "soft_trip", limit_gwt=0.02 / GWT_N):
            bench.jog(axis, by_mm)
    assert bench.jog("z", 2.0).ended_by is None
    assert bench.height_mm == pytest.approx(1.2, abs=0.003)


def test_up_into_something_it_stops(at_hand: Callable[..., AtHand]) -> None:
    bench = at_hand(soft_trip_n=0.02)
    from_s = bench.clock.monotonic_s() + 2.0
    bench.spring.true_gwt = lambda t_s: 30.0 + t_s if t_s > from_s else 0.0  # type: ignore[method-assign]
    ended = codes(bench.jog("z", 12.0, 2.0))
    assert ended == ["soft_trip"], "what ended it is all there is to say: there is no farther to go from it"
    assert bench.height_mm < 3.0 + 2.0 * 3.2


def test_a_sensor_beyond_its_range_lets_it_go_up_and_nowhere_else(at_hand: Callable[..., AtHand]) -> None:
    bench = at_hand(above_mm=0.5, zero=ForceZero(0.0, 0.0))
    bench.spring.offset_gwt = 500.0
    for axis, by_mm in (("x", 1.0), ("z", -0.2)):
        with raises(LimitError, "no_reading") as refused:
            bench.jog(axis, by_mm)
        assert isinstance(refused.value.__cause__, NoReadingError)
        assert refused.value.__cause__.out_of_range
    assert bench.jog("z", 1.0).ended_by is None
    assert bench.height_mm == pytest.approx(1.5, abs=0.003)


# --- the sensor ---


@pytest.mark.parametrize(("axis", "by_mm"), [("x", 1.0), ("x", -1.0), ("z", -0.5), ("z", 1.0)])
def test_a_sensor_that_does_not_answer_moves_nothing(at_hand: Callable[..., AtHand], axis: str, by_mm: float) -> None:
    bench = at_hand(zero=ForceZero(0.0, 0.0))
    at = bench.x_mm, bench.height_mm

    def nan() -> ForceReading:
        return ForceReading(float("nan"), True, bench.clock.monotonic_s())

    bench.sensing.sensor.read = nan  # type: ignore[method-assign]
    with raises(LimitError, "not_a_number"):
        bench.jog(axis, by_mm)
    assert (bench.x_mm, bench.height_mm) == at


def test_without_force_it_moves_and_depth_still_counts(at_hand: Callable[..., AtHand]) -> None:
    bench = at_hand(felt=False, above_mm=1.0)
    assert bench.jog("z", -2.0).ended_by is None
    assert bench.height_mm == pytest.approx(-1.0, abs=0.003)
    with raises(LimitError, "too_deep", limit_mm=1.5):
        bench.jog("z", -1.0)


def test_without_a_zero_force_counts_from_before_the_motion(at_hand: Callable[..., AtHand]) -> None:
    """A holder of 80 gwt hangs on the sensor, and the soft trip is 51."""
    bench = at_hand(above_mm=0.3, soft_trip_n=0.5)
    bench.spring.offset_gwt = 80.0
    moved = bench.jog("z", -1.0)
    assert codes(moved)[0] == "touched"
    assert moved.force_gwt == pytest.approx(bench.worst_gwt, abs=0.02)


def test_a_zero_that_has_drifted_does_not_hide_a_touch(at_hand: Callable[..., AtHand]) -> None:
    bench = at_hand(above_mm=0.3, zero=ForceZero(0.0, 0.0))
    bench.spring.offset_gwt = 3.0
    assert codes(bench.jog("z", -1.0))[0] == "touched"
    assert bench.worst_gwt <= bench.one_increment_gwt(TOUCH_GWT)


def test_position_and_force_are_shown_while_it_moves(at_hand: Callable[..., AtHand]) -> None:
    bench = at_hand(above_mm=0.3)
    bench.jog("z", -0.6)
    forces = [force for _, force in bench.shown]
    assert len({round(at.z_mm, 3) for at, _ in bench.shown}) >= 5
    assert forces[0] == pytest.approx(0.0, abs=0.011)
    assert max(force for force in forces if force is not None) >= TOUCH_GWT


@pytest.mark.quick(rows=lambda at_hand, axis, by_mm, felt: at_hand == "grbl" or felt)
@pytest.mark.parametrize("felt", [True, False])
@pytest.mark.parametrize(("axis", "by_mm"), [("x", 1.5), ("z", 1.5), ("z", -1.5), ("z", -0.123)])
def test_a_way_that_is_free_is_gone_to_its_end(
    at_hand: Callable[..., AtHand], axis: str, by_mm: float, felt: bool
) -> None:
    bench = at_hand(felt=felt, zero=ForceZero(0.0, 0.0))
    before = {"x": bench.x_mm, "z": bench.height_mm}[axis]
    assert bench.jog(axis, by_mm).ended_by is None
    assert {"x": bench.x_mm, "z": bench.height_mm}[axis] - before == pytest.approx(by_mm, abs=0.0035)


@pytest.mark.parametrize(("busy_s", "moves"), [(0.9, True), (1.4, False)])
def test_a_sensor_that_is_busy_at_rest_is_waited_for(
    at_hand: Callable[..., AtHand], busy_s: float, moves: bool
) -> None:
    """BUSY_S = 1 s: a balance may find no value for a moment; then it is as good as silent."""
    bench = at_hand(zero=ForceZero(0.0, 0.0))
    sensor, read = bench.sensing.sensor, bench.sensing.sensor.read
    until_s = bench.clock.monotonic_s() + busy_s

    def busy() -> ForceReading:
        reading = read()
        if bench.clock.monotonic_s() < until_s:
            raise ForceBusy("no value now", "no_value_now")
        return reading

    sensor.read = busy  # type: ignore[method-assign]
    if moves:
        assert bench.jog("x", 0.5).ended_by is None
    else:
        with raises(LimitError, "no_reading") as refused:
            bench.jog("x", 0.5)
        assert "no_value_now" in causes(refused.value)


# --- steps, speeds, and a key that is let go ---


def jogged(bench: AtHand) -> list[tuple[float, float]]:
    """The steps down that a GRBL board was told along z, each to a work zero of its own: mm and mm/s."""
    chunks = [json.loads(line) for line in bench.wire.getvalue().splitlines()]
    texts = [bytes.fromhex(c["hex"]) for c in chunks if c["dir"] == "tx" and c["port"] == "stage"]
    told = re.findall(rb"G92X0Y0Z([\d.]+)G90G21G94F[\d.]+\n(?:\$G\n)?\?\$J=Z0F([\d.]+)\n", b"".join(texts))
    return [(-float(mm), round(float(feed) / 60, 6)) for mm, feed in told]


def test_down_to_clearance_by_descent_steps_and_then_by_increments() -> None:
    """From 3.1 mm with clearance at 2: two whole steps and what is left, then increments; at most 5 mm/s."""
    bench = AtHand("grbl", above_mm=3.1)
    assert bench.jog("z", -1.22, 10.0).ended_by is None
    assert jogged(bench) == [
        *[(-0.5, 5.0)] * 2,
        *[(pytest.approx(-0.1, abs=2e-4), 5.0)],
        *[(-0.05, 5.0)] * 2,
        *[(pytest.approx(-0.02, abs=2e-4), 5.0)],
    ]


def test_where_it_came_to_rest_on_the_way_down_is_told(at_hand: Callable[..., AtHand]) -> None:
    assert at_hand().jog("z", -0.7).at.z_mm - APEX_MM == pytest.approx(3.0 - 0.7, abs=0.004)


def test_a_slower_speed_is_kept() -> None:
    bench = AtHand("grbl", above_mm=0.5)
    bench.jog("z", -0.1, 1.0)
    assert jogged(bench) == [(-0.05, 1.0)] * 2


def test_with_nothing_held_nothing_moves(at_hand: Callable[..., AtHand]) -> None:
    bench = at_hand()
    at = bench.height_mm
    moved = bench.hand.go(lambda: None, 2.0)
    assert (moved.force_gwt, moved.ended_by) == (None, None)
    assert moved.at.z_mm == pytest.approx(APEX_MM + 3.0, abs=0.002)
    assert bench.height_mm == at
    assert not bench.shown


@pytest.mark.parametrize("axis", ["x", "z"])
@pytest.mark.parametrize("felt", [True, False])
def test_a_key_that_is_let_go_ends_it_well(at_hand: Callable[..., AtHand], axis: Any, felt: bool) -> None:
    bench = at_hand(above_mm=2.0, felt=felt, zero=ForceZero(0.0, 0.0))
    until_s = bench.clock.monotonic_s() + 1.5
    start = bench.x_mm, bench.height_mm
    way = Direction(axis, -1)
    moved = bench.hand.go(lambda: way if bench.clock.monotonic_s() < until_s else None, 1.0)
    assert moved.ended_by is None
    gone_mm = {"x": start[0] - bench.x_mm, "z": start[1] - bench.height_mm}[axis]
    assert 0.1 < gone_mm < 1.8
    assert bench.clock.monotonic_s() < until_s + 1.0


def test_the_deepest_that_is_allowed_is_allowed(at_hand: Callable[..., AtHand]) -> None:
    """limits.max_doi_mm = 1.5 and not a micrometre more, by a distance; with a key as deep as whole steps go."""
    bench = at_hand(felt=False, above_mm=0.22)  # no whole number of increments above
    with raises(LimitError, "too_deep", depth_mm=pytest.approx(1.501, abs=0.002), limit_mm=1.5):
        bench.jog("z", -1.721)
    beyond_mm = bench.hand.look().at.z_mm - APEX_MM + 1.5 + 1e-8  # by what floats may be off
    assert bench.jog("z", -beyond_mm).ended_by is None
    assert bench.height_mm == pytest.approx(-1.5, abs=0.003)
    key = at_hand(felt=False, above_mm=0.5)
    assert codes(key.hand.go(lambda: Direction("z", -1), 2.0)) == ["too_deep"]
    assert key.height_mm == pytest.approx(-1.5, abs=0.003)


def test_near_the_trip_steps_become_smaller(at_hand: Callable[..., AtHand]) -> None:
    """It comes within a tenth of a gwt of nine tenths of the trip, 4.59 gwt, where an increment has 0.4 gwt."""
    bench = at_hand(soft_trip_n=0.05, above_mm=0.2, placed=False)
    for _ in range(4):
        bench.jog("z", -1.2)
    assert 4.4 < bench.worst_gwt < 4.75


@pytest.mark.parametrize("felt", [True, False])
def test_a_look_says_where_it_stands_and_what_is_felt(at_hand: Callable[..., AtHand], felt: bool) -> None:
    bench = at_hand(felt=felt, zero=ForceZero(0.0, 0.0))
    bench.spring.offset_gwt = 2.5
    bench.clock.wait_s(0.5)
    seen = bench.hand.look()
    assert seen.at.z_mm == pytest.approx(APEX_MM + 3.0, abs=0.002)
    assert seen.force_gwt == (pytest.approx(2.5, abs=0.011) if felt else None)
    assert bench.shown == [(seen.at, seen.force_gwt)]
    assert abs(bench.hand.steps_per_mm("z")) == pytest.approx(400.0)


def test_it_is_shown_while_it_moves_and_at_every_rest(at_hand: Callable[..., AtHand]) -> None:
    """At rest the settled force of each step; in motion more often than that."""
    bench = at_hand(above_mm=0.5, zero=ForceZero(0.0, 0.0))
    bench.jog("z", -0.2)
    rests = [at.z_mm for at, _ in bench.shown]
    assert {round(z - APEX_MM, 2) for z in rests} >= {0.45, 0.4, 0.35, 0.3}
    bench.shown.clear()
    bench.jog("x", 1.0, 1.0)
    assert len({round(at.x_mm, 2) for at, _ in bench.shown}) > 4
    bench.shown.clear()
    bench.spring.wall_x_mm = bench.x_mm + 0.2
    moved = bench.jog("x", 2.0, 1.0)
    assert moved.ended_by is not None
    assert bench.shown[-1] == (moved.at, moved.force_gwt), "what ended it is shown too"


# --- where it is, and what is on record for the next command ---


@pytest.mark.parametrize("axis", ["x", "z"])
def test_a_stage_that_leaves_its_way_has_lost_its_place(
    at_hand: Callable[..., AtHand], axis: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two reports in a row say so; the carriage may be anywhere, so the finger may be touched."""
    bench = at_hand(zero=ForceZero(0.0, 0.0))
    status, looks = bench.bench.stage.status, itertools.count()
    monkeypatch.setattr(
        bench.bench.stage,
        "status",
        lambda: replace(status(), y_mm=status().y_mm + 5.0) if next(looks) > 4 else status(),
    )
    assert codes(bench.jog(axis, 1.0)) == ["off_its_way"]
    assert (bench.hand.placed, bench.hand.may_touch) == (False, True)


def test_a_stage_that_lost_its_reference_has_lost_its_place(
    at_hand: Callable[..., AtHand], monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = at_hand()
    status = bench.bench.stage.status
    monkeypatch.setattr(bench.bench.stage, "status", lambda: replace(status(), referenced=False))
    bench.hand.go(lambda: None, 2.0)
    assert (bench.hand.placed, bench.hand.may_touch) == (False, True)


def test_only_a_place_that_is_lost_puts_the_finger_in_doubt(at_hand: Callable[..., AtHand]) -> None:
    hand = at_hand().hand
    hand.may_touch = False
    for placed, may_touch in ((True, False), (False, True), (True, True)):
        hand.set_placed(placed=placed)
        assert hand.may_touch is may_touch


@pytest.mark.parametrize(("by_mm", "kept"), [(0.5, []), (1.0, []), (1.015, []), (1.03, ["unknown", "unknown"])])
def test_down_to_clearance_no_touch_is_possible(
    at_hand: Callable[..., AtHand], by_mm: float, kept: list[str]
) -> None:
    """From 3 mm with clearance at 2 mm; heights within 0.02 mm of it are clearance."""
    bench = at_hand(zero=ForceZero(0.0, 0.0))
    bench.hand.may_touch = False
    found: list[str] = []
    bench.hand.keep_contact = lambda known: found.append(known.kind)
    assert bench.jog("z", -by_mm).ended_by is None
    assert found == kept


@pytest.mark.parametrize(
    ("to_mm", "kind"), [(2.0, "lifted"), (1.985, "lifted"), (1.97, "unknown"), (0.05, "unknown")]
)
def test_up_to_clearance_the_finger_is_clear_and_where_is_on_record(
    at_hand: Callable[..., AtHand], to_mm: float, kind: str
) -> None:
    bench = at_hand(above_mm=-0.05, skin_mm=-1.0, zero=ForceZero(0.0, 0.0))
    bench.jog("x", 0.5)
    bench.spring.skin_mm = 0.0
    found: list[KnownContact] = []
    bench.hand.may_touch, bench.hand.keep_contact = True, found.append
    assert bench.jog("z", to_mm + 0.05).ended_by is None
    assert (found[-1].kind, bench.hand.may_touch) == (kind, kind != "lifted")
    assert (found[-1].x_mm, found[-1].height_mm) == pytest.approx((0.5, to_mm), abs=0.003)


@pytest.mark.parametrize("then", [None, Direction("z", -1), Direction("x", 1)], ids=["let go", "down", "aside"])
@pytest.mark.parametrize("after_s", [0.0, 0.3])
def test_another_key_at_clearance_ends_the_way_up(
    at_hand: Callable[..., AtHand], then: Direction | None, after_s: float
) -> None:
    """Once lifted it would go on in one motion: never down or sideways. Pressed at once, or in the measurement."""
    bench = at_hand(above_mm=1.9, zero=ForceZero(0.0, 0.0))
    bench.hand.may_touch = True
    until_s: list[float] = []

    def held() -> Direction | None:
        if not until_s and bench.height_mm >= 1.99:
            until_s.append(bench.clock.monotonic_s() + after_s)
        return then if until_s and bench.clock.monotonic_s() >= until_s[0] else Direction("z", 1)

    assert bench.hand.go(held, 0.5).ended_by is None
    assert bench.clock.monotonic_s() < until_s[0] + after_s + 0.8  # one measurement at rest
    assert (bench.x_mm, bench.height_mm) == pytest.approx((0.0, 2.0), abs=0.02)
