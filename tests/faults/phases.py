"""How hard a finger is pressed when the force sensor fails, by what the rig was doing and by how the sensor fails.

Finger, bench and target are those of `outcomes`; drivers, wire and bytes are real. The worst force is that of the
finger, looked at every 2 ms, not what the sensor said.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rig.devices.base import ForceError, StageError
from rig.engine import EngineError, TripError, indent, verbs
from rig.engine.motion import DOWN
from rig.engine.steps import Steps
from rig.errors import RigError
from rig.plan.config import Config
from rig.transport import TransportError
from rig.units import GWT_N
from studies.faults.faulty_bench import PREDICTED, SOFT_TRIP_N, TARGET, FaultyBench

LAG_S, LATE_S, SATURATED_GWT, BLINK_S = 0.5, 0.5, 1.0, 0.15

Felt = Callable[[FaultyBench, float], Callable[[float], float]]
"""What the sensor feels (N) at an instant, from the instant on at which it failed."""


def _frozen(bench: FaultyBench, from_s: float) -> Callable[[float], float]:
    value_n = bench.true_n(from_s)
    return lambda t_s: value_n


def _slow(bench: FaultyBench, _from_s: float) -> Callable[[float], float]:
    """A low pass of the first order."""
    ago_s = np.linspace(0.0, 4 * LAG_S, 41)
    weight = np.exp(-ago_s / LAG_S)
    weight /= weight.sum()
    return lambda t_s: float(sum(w * bench.true_n(max(t_s - s, 0.0)) for w, s in zip(weight, ago_s, strict=True)))


FAULTS: dict[str, Felt] = {
    "frozen at 0": lambda bench, from_s: lambda t_s: 0.0,
    "frozen at its value": _frozen,
    f"slow, {LAG_S:g} s": _slow,
    f"{LATE_S:g} s late": lambda bench, from_s: lambda t_s: bench.true_n(max(t_s - LATE_S, 0.0)),
    f"saturated at {SATURATED_GWT:g} gwt": lambda bench, from_s: (
        lambda t_s: min(bench.true_n(t_s), SATURATED_GWT * GWT_N)
    ),
    "sign flipped": lambda bench, from_s: lambda t_s: -bench.true_n(t_s),
    "halved": lambda bench, from_s: lambda t_s: 0.5 * bench.true_n(t_s),
    "intermittent": lambda bench, from_s: lambda t_s: bench.true_n(t_s) if math.floor(t_s / BLINK_S) % 2 else 0.0,
}
SHOWN_BY_NOTHING = ("frozen at 0", "frozen at its value", f"saturated at {SATURATED_GWT:g} gwt", "halved")
"""What one sensor alone cannot always show, because it might be true: depth bounds these."""

IN_A_PRESS = ("approach", "back off", "touch", "press", "hold")
PHASES = (*IN_A_PRESS, "lift", "move", "coming back", "park", "home", "jog")
NEARER_MM = 1.5
NO_FAULT = "none"
WAYS_BACK = {"by increments": {"retouch_margin_mm": 20.0}, "in one move": {}}


@dataclass(frozen=True)
class PhaseOutcome:
    """The worst force on the finger, gwt, and what ended it, if anything did."""

    worst_gwt: float
    ended_by: RigError | None


def deep_gwt() -> float:
    """What the finger answers at the deepest that is ever allowed, and one increment more."""
    config = Config()
    depth_mm = config.limits.max_doi_mm + config.habits.increment_mm
    return PREDICTED.force_at(PREDICTED.contact_mm - depth_mm) / GWT_N


def suffer(phase: str, fault: str, folder: Path) -> PhaseOutcome:
    """The sensor fails in this phase, in this way, and stays so."""
    acts = {"jog": _jog, "home": _home, "park": _park, "coming back": _come_back}
    return _suffer(acts.get(phase, _presses), phase, fault, FaultyBench(folder, _tables(phase)))


def come_nearer(way: str, fault: str, folder: Path, devices: Mapping[str, Any] | None = None) -> PhaseOutcome:
    """The finger comes nearer after its first press, and the sensor fails before the second one at the same place."""
    bench = FaultyBench(folder, {**_tables("coming back"), "habits": WAYS_BACK[way], **(devices or {})})
    return _suffer(_come_nearer, "coming back", fault, bench)


def _tables(phase: str) -> dict[str, Mapping[str, Any]]:
    return {"limits": {"soft_trip_n": SOFT_TRIP_N, "on_trip": "park" if phase == "park" else "retract"}}


def _suffer(
    act: Callable[[FaultyBench, str, Callable[[], None]], None], phase: str, fault: str, bench: FaultyBench
) -> PhaseOutcome:
    def strike() -> None:
        if fault != NO_FAULT:
            bench.felt_n = FAULTS[fault](bench, bench.clock.monotonic_s())

    ended_by: RigError | None = None
    try:
        _ready(bench)
        act(bench, phase, strike)
    except (EngineError, StageError, ForceError, TransportError) as error:
        ended_by = error
    finally:
        bench.journal.close()
    return PhaseOutcome(bench.worst_n / GWT_N, ended_by)


def _ready(bench: FaultyBench) -> None:
    verbs.mount(bench.engine, "bar:3.0")
    verbs.home(bench.engine)
    verbs.zero(bench.engine)


def _indent(bench: FaultyBench, x_mm: float) -> None:
    verbs.move_to(bench.engine, x_mm)
    indent(bench.engine, TARGET, hold_s=2.0, expected_contact_mm=PREDICTED.contact_mm)


def _presses(bench: FaultyBench, phase: str, strike: Callable[[], None]) -> None:
    bench.after({"lift": "hold_end", "move": "retract"}.get(phase, phase), strike)
    for x_mm in (0.0, 0.5):
        _indent(bench, x_mm)


def _come_back(bench: FaultyBench, _phase: str, strike: Callable[[], None]) -> None:
    """To the place of the press before, in one move, when what was felt there has died away in a slow sensor."""

    def fail() -> None:
        bench.worst_n = 0.0
        strike()

    _indent(bench, 0.0)
    verbs.rest(bench.engine, 10 * LAG_S)
    bench.after("indentation_start", fail)
    _indent(bench, 0.0)


def _come_nearer(bench: FaultyBench, phase: str, strike: Callable[[], None]) -> None:
    bench.after("retract", lambda: setattr(bench, "nearer_mm", NEARER_MM))
    _come_back(bench, phase, strike)


def _park(bench: FaultyBench, _phase: str, strike: Callable[[], None]) -> None:
    """A trip in a hold."""

    def trip() -> None:
        strike()
        bench.engine.trip(TripError("for the table"))

    bench.after("hold", trip)
    _indent(bench, 0.0)


def _home(bench: FaultyBench, _phase: str, strike: Callable[[], None]) -> None:
    """From a hold in which the stage was stopped, the indentor still in the finger."""

    def stop() -> None:
        bench.engine.stop()
        strike()
        raise StageError("stopped")

    bench.after("hold", stop)
    try:
        _indent(bench, 0.0)
    except StageError:
        verbs.home(bench.engine)


def _jog(bench: FaultyBench, _phase: str, strike: Callable[[], None]) -> None:
    """Down to the finger by steps, and on and on after the sensor has failed."""
    verbs.move_to(bench.engine, 0.0)
    steps = Steps(bench.engine)
    while steps.make(DOWN, 0.5, 2.0).ended_by is None:
        pass
    strike()
    problem = None
    while problem is None:
        problem = steps.make(DOWN, 0.05, 2.0).ended_by  # or too deep, and then refused
    raise StageError(f"{problem}", problem.code)
