"""How hard a ramp presses a finger that is not the one whose stiffness the press before it measured.

A press has measured a finger of springs, so many gwt at 1 mm; then another finger lies there: stiffer throughout,
or with a wall under its skin. Each ramp is as fast as the rig allows, or a little slower, and each finger lies at
several heights, so that readings fall at different instants. Drivers, wire and bytes are real, the trip is 16 gwt,
and the worst force is that of the finger, looked at every 2 ms. Each row has the ramp of the worst force, and how
far below its trip the indentor came to rest, beside the distance that the ramp assumes.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from rig.engine import verbs
from rig.engine.indentation import ramp
from rig.engine.limits import CONTACT_EXPONENT, RampBound, TouchedPlace
from rig.errors import RigError
from rig.records import ContactFit
from rig.units import GWT_N
from studies.faults.campaign.world import BENCHES
from studies.faults.faulty_bench import PREDICTED, SOFT_TRIP_N, FaultyBench

NEAR = {"frame": {"pad_centre_x_mm": -12.0, "apex_z_mm": -12.0}}
"""A short way from the switches, below where a virtual stage begins."""

Law = Callable[[float], float]
"""Force of a finger (gwt) at a depth (mm)."""


@dataclass(frozen=True)
class OtherFinger:
    """Finger that is so many times as stiff as the measured one, with a wall (gwt/mm) under some of its skin (mm)."""

    times: float = 1.0
    skin_mm: float = 0.0
    wall_gwt_mm: float = 0.0

    def law(self, at_1_mm_gwt: float) -> Law:
        """Return its force, where the measured one answers so much at 1 mm."""
        soft = self.times * at_1_mm_gwt
        return lambda mm: soft * max(mm, 0.0) ** CONTACT_EXPONENT + self.wall_gwt_mm * max(mm - self.skin_mm, 0.0)


@dataclass(frozen=True)
class RampCase:
    """Ramp on a bench to a depth, at a share of the highest speed, after a press on a finger of a stiffness.

    nearer_mm: by how much the finger lies higher than expected. late_s: delay of the cell, which the rig knows.
    """

    bench: str
    at_1_mm_gwt: float
    doi_mm: float
    share: float
    nearer_mm: float
    late_s: float = 0.0


@dataclass(frozen=True)
class RampOutcome:
    """Worst force of a ramp, its trip and speed, and how far it went below the trip (mm)."""

    case: RampCase
    worst_gwt: float
    trip_gwt: float
    speed_mm_s: float
    gone_mm: float
    stop_mm: float


OTHERS = {
    "5 times as stiff": OtherFinger(times=5.0),
    "20 times as stiff": OtherFinger(times=20.0),
    "a wall of 200 gwt/mm under 0.3 mm of skin": OtherFinger(skin_mm=0.3, wall_gwt_mm=200.0),
}


class ChangingFinger(FaultyBench):
    """Bench whose finger obeys a law."""

    law: Law = staticmethod(OtherFinger().law(10.0))
    deepest_mm = 0.0

    def true_n(self, t_s: float) -> float:
        """Force of the finger that lies there now."""
        doi_mm = PREDICTED.contact_mm - self.reached_mm(self._above_apex_mm(t_s))
        self.deepest_mm = max(self.deepest_mm, doi_mm)
        return self.law(doi_mm) * GWT_N


def ramp_into(other: OtherFinger, case: RampCase, folder: Path) -> RampOutcome:
    """Return what becomes of a ramp into another finger."""
    tables = {**BENCHES[case.bench], **NEAR, "limits": {"soft_trip_n": SOFT_TRIP_N}}
    tables["force"] = {**tables.get("force", {}), "latency_s": case.late_s}
    bench = ChangingFinger(folder, tables)
    bench.nearer_mm = case.nearer_mm
    bench.felt_n = lambda t_s: bench.true_n(t_s - case.late_s)
    bench.law = other.law(case.at_1_mm_gwt)
    engine, doi_mm = bench.engine, case.doi_mm
    measured_gwt = OtherFinger().law(case.at_1_mm_gwt)(doi_mm)
    fastest_mm_s = RampBound.of(bench.config, 1.0, SOFT_TRIP_N / GWT_N, measured_gwt, doi_mm).fastest_mm_s
    speed_mm_s = case.share * min(fastest_mm_s, bench.config.limits.max_press_speed_mm_s)
    bound = RampBound.of(bench.config, speed_mm_s, SOFT_TRIP_N / GWT_N, measured_gwt, doi_mm)
    verbs.mount(engine, "bar:3.0")
    verbs.home(engine)
    verbs.zero(engine)
    verbs.move_to(engine, 0.0)
    contact = ContactFit(0.05, PREDICTED.contact_mm - 0.03, 0.05, PREDICTED.contact_mm, 3)
    engine.touched.at(engine.x_mm, engine.along_mm, TouchedPlace(contact, reached=(doi_mm, measured_gwt)))
    try:
        ramp(engine, doi_mm, speed_mm_s, hold_s=0.0, expected_contact_mm=PREDICTED.contact_mm)
    except RigError:
        pass  # The trip of the ramp.
    finally:
        bench.journal.close()
    gone_mm = bench.deepest_mm - _depth_of(bound.trip_gwt, bench.law)
    return RampOutcome(case, bench.worst_n / GWT_N, bound.trip_gwt, speed_mm_s, max(gone_mm, 0.0), bound.stop_mm)


def _depth_of(force_gwt: float, law: Law) -> float:
    low_mm, high_mm = 0.0, 10.0
    for _ in range(50):
        mm = (low_mm + high_mm) / 2
        low_mm, high_mm = (mm, high_mm) if law(mm) < force_gwt else (low_mm, mm)
    return low_mm
