"""A drift that takes a touch through zero at one reading does not make it a lift, wherever one is confirmed.

A motor stalls in a touch of 0.32 gwt while the sensor drifts by 0.2 gwt/s, and the zero crossing is put everywhere in
the seconds after. `rtu/jog up/9660/z stalls + drifts down` of the fault campaign was one such case.
"""

from collections.abc import Callable
from contextlib import nullcontext, suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rig.engine import Engine, EngineError, verbs
from rig.engine.bench_memory import BenchMemory
from rig.engine.motion import Direction
from rig.engine.sensing import ForceZero, NoReadingError, Sensing
from rig.engine.steps import Steps
from rig.errors import LimitError
from rig.manual.session import ManualSession
from rig.settings import RigSettings
from rig.units import GWT_N
from sim.devices.clock import VirtualClock
from tests.error_codes import raises
from tests.faults.catalogue import GRBL, MODBUS
from tests.rig.hand_bench import SessionBench, Spring
from tests.rig.test_mechanical_faults import Slipping
from tests.stub_bench import StubBench, StubSensor

DRIFT_GWT_S, TOUCH_GWT = 0.2, 0.05
CROSSINGS_S = np.arange(0.1, 4.0, 0.4)
"""Readings within the threshold last 0.5 s, so that every reading of the next four seconds is in one of them."""
STAGES = {"grbl": GRBL, "modbus": MODBUS}


class Stalled(Spring):
    """A finger under a motor that no longer turns, read by a sensor whose reading crosses zero at an instant."""

    stalled = False
    crosses_s = np.inf

    def true_gwt(self, t_s: float) -> float:
        return 0.32 if self.stalled else super().true_gwt(t_s)

    def force_n(self, t_s: float) -> float:
        return DRIFT_GWT_S * (self.crosses_s - t_s) * GWT_N if self.stalled else super().force_n(t_s)


class Drifted:
    """A bench by hand that was in a touch, over the crossing at an instant from now."""

    def __init__(self, kind: str, above_mm: float, crosses_in_s: float, *, may_touch: bool = True) -> None:
        self.bench = SessionBench(kind, above_mm=above_mm, zero=ForceZero(0.0, 0.0), spring=Stalled)
        engine = self.bench.session.engine
        engine.contact = replace(engine.contact, may_touch=may_touch)
        spring = self.bench.spring
        assert isinstance(spring, Stalled)
        spring.stalled, spring.crosses_s = True, self.bench.clock.monotonic_s() + crosses_in_s

    def aside(self) -> float:
        """Try to go sideways by 1 mm; returns how far it went."""
        from_mm = self.bench.x_mm
        with suppress(LimitError):
            self.bench.step("x", 1.0)
        return abs(self.bench.x_mm - from_mm)


@pytest.mark.parametrize("kind", ["grbl", "leadshine"])
def test_a_drift_through_zero_after_a_step_up_is_not_recorded_as_a_lift(kind: str) -> None:
    for crossing_s in CROSSINGS_S:
        at_hand = Drifted(kind, 1.0, crossing_s)
        if at_hand.bench.step("z", 1.2).known.may_touch:
            continue
        pytest.fail(f"the record says lifted, with the crossing {crossing_s:.2f} s after the jog began")


def test_a_drift_through_zero_at_clearance_is_not_reported_as_a_lift() -> None:
    """Nothing was below clearance since the last lift; a finger came up."""
    for crossing_s in CROSSINGS_S:
        at_hand = Drifted("grbl", 2.5, crossing_s, may_touch=False)
        assert at_hand.bench.session.contact().known.may_touch, f"{crossing_s:.2f} s"


@pytest.mark.parametrize("kind", ["grbl", "leadshine"])
def test_manual_control_makes_no_step_sideways_in_contact_while_the_force_drifts_through_zero(kind: str) -> None:
    for crossing_s in CROSSINGS_S:
        assert Drifted(kind, 2.5, crossing_s).aside() < 0.003, f"{crossing_s:.2f} s"


def _leave(engine: Engine) -> None:
    verbs.retract(engine)
    verbs.move_to(engine, 1.0)


@pytest.mark.quick(
    rows=lambda stage: stage == "grbl"
)  # the engine's; both stages: tests/rig/test_mechanical_faults.py
@pytest.mark.parametrize("stage", STAGES)
def test_a_run_makes_no_move_sideways_in_contact_while_the_force_drifts_through_zero(
    tmp_path: Path, stage: str
) -> None:
    """The motor stalls in a touch; then `retract` and `move_to`."""
    for n, crossing_s in enumerate(CROSSINGS_S):
        (tmp_path / str(n)).mkdir()
        bench = Slipping(tmp_path / str(n), STAGES[stage])
        engine = bench.engine
        verbs.mount(engine, "bar:3.0")
        verbs.home(engine)
        verbs.zero(engine)
        verbs.move_to(engine, 0.0)
        while (true_gwt := bench.true_n(bench.clock.monotonic_s()) / GWT_N) < 0.3:
            engine.go_to_height(engine.height_mm - 0.05, 1.0)
        bench.slip(1.0)
        from_s = bench.clock.monotonic_s() + crossing_s - true_gwt / DRIFT_GWT_S
        bench.extra_n = lambda t_s, from_s=from_s: -DRIFT_GWT_S * GWT_N * (t_s - from_s)
        with pytest.raises(EngineError) as found:
            _leave(engine)
        bench.journal.close()
        assert found.value.code == "not_lifted"
        assert bench.dragged_gwt == 0.0, f"{crossing_s:.2f} s"


@pytest.mark.parametrize("kind", ["grbl", "leadshine"])
def test_rig_zero_refuses_a_touch_whose_force_drifts_through_zero(kind: str) -> None:
    """`rig zero` refuses a load against the last zero on record."""
    for crossing_s in CROSSINGS_S:
        at_hand = Drifted(kind, 2.5, crossing_s).bench
        BenchMemory(at_hand.config).record_zero(ForceZero(0.0, 0.0))
        with pytest.raises(LimitError) as found:
            at_hand.session.zero()
        assert found.value.code in ("maybe_touched", "unsteady"), f"{crossing_s:.2f} s"


# --- what one sensor's readings at rest say ---


def _resting(shows_gwt: Callable[[float], float]) -> Sensing:
    """A sensor that shows a force at so many seconds from now."""
    clock = VirtualClock(1.7e9, 100.0)
    sensor = StubSensor(clock)

    def show() -> None:
        sensor.shows_gwt = shows_gwt(clock.monotonic_s() - 100.0)

    sensor.at_read = show
    sensing = Sensing(RigSettings(), clock, sensor)
    sensing.zero = ForceZero(0.0, 0.0)
    return sensing


@pytest.mark.parametrize(
    ("shows_gwt", "at_rest_gwt"),
    [
        (lambda t_s: 0.01, 0.01),
        (lambda t_s: 8.0, 8.0),
        (lambda t_s: 0.02 * (round(t_s / 0.55) % 2), 0.0),  # within half a touch
        (lambda t_s: 8.0 * np.exp(-t_s / 0.3), 0.0),  # a slow cell
        (lambda t_s: 8.0 if t_s < 0.5 else 0.0, 0.0),  # a late one
        (lambda t_s: 0.1 - 0.2 * t_s, -0.5),  # a drift: it is a touch in the end
    ],
    ids=["air", "touch", "wavers", "slow", "late", "drift"],
)
def test_the_force_at_rest_is_two_readings_that_agree(
    shows_gwt: Callable[[float], float], at_rest_gwt: float
) -> None:
    assert _resting(shows_gwt).at_rest_gwt() == pytest.approx(at_rest_gwt, abs=0.03)


@pytest.mark.parametrize("noise_gwt", [0.0, 0.02])
def test_readings_that_never_agree_give_no_force_at_rest(noise_gwt: float) -> None:
    """0.04 and −0.04 gwt in turn, half a second apart, both below a touch of 0.05 gwt; within a noise they agree."""
    sensing = _resting(lambda t_s: 0.04 if round(t_s / 0.55) % 2 else -0.04)
    sensing.zero = ForceZero(0.0, noise_gwt)
    with raises(NoReadingError, "unsteady") if not noise_gwt else nullcontext():
        assert sensing.at_rest_gwt() == pytest.approx(0.04)


def test_a_force_that_does_not_settle_refuses_a_step_sideways() -> None:
    bench = StubBench()
    steps = Steps(bench.ready())
    bench.force.at_read = lambda: _unsteady(bench)
    with raises(LimitError, "unsteady"):
        steps.make(Direction("x", 1), 1.0, 1.0)
    assert bench.engine.x_mm == 0.0


def _unsteady(bench: StubBench) -> None:
    """0.04 and −0.04 gwt in turn."""
    bench.force.shows_gwt = -0.04 if bench.force.shows_gwt > 0 else 0.04


def test_rig_zero_refuses_a_force_that_does_not_settle() -> None:
    """The same two readings before `rig zero`: it names them, and the recorded zero stays."""
    bench = StubBench()
    BenchMemory(bench.settings).record_zero(ForceZero(0.0, 0.0))
    session = ManualSession(bench.settings, bench, BenchMemory(bench.settings).read())
    with session.begun():
        bench.force.at_read = lambda: _unsteady(bench)
        with raises(LimitError, "unsteady"):
            session.zero()
    assert BenchMemory(bench.settings).read().zero == ForceZero(0.0, 0.0)


def test_the_measured_noise_of_a_sensor_does_not_count_as_drift() -> None:
    """Readings with a standard deviation of 0.02 gwt, measured at the zero: the threshold is 0.12 gwt then."""
    random = np.random.default_rng(20261126)
    sensing = _resting(lambda t_s: float(random.normal(0.0, 0.02)))
    sensing.zero = ForceZero(0.0, 0.02)
    assert all(abs(sensing.at_rest_gwt()) < 0.12 for _ in range(200))
