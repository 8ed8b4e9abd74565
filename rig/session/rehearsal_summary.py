"""Summary that `rig check` and `rig run` print before a motion: steps, forces, margins, stopping."""

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, NotRequired

from rig.devices.registry import stage_ports
from rig.engine import EngineError
from rig.engine.limits import CONTACT_EXPONENT, Stopping
from rig.plan.config import Config
from rig.plan.plan import Plan, ramp_bound
from rig.plan.sample_age import SampleAge
from rig.protocol.script import Script
from rig.records import PlannedIndentation
from rig.session.rehearse import Rehearsed, rehearsed
from rig.session.session import Session
from rig.units import GWT_N
from rig_shared.outputs import Name, Output, Range, Ratio, Shape
from rig_shared.plural import number_of
from sim.config import FingertipConfig
from sim.contact.shapes import with_size
from sim.models.default_finger import is_default_finger
from sim.models.small_strain_error import SmallStrain, SmallStrainJson, small_strain

if TYPE_CHECKING:
    from sim.models.fingertip import Fingertip


class MarginsJson(Output):
    """Margins to the limits."""

    force_gwt: float
    doi_mm: float
    mean_pressure_kpa: float
    contact_s: float


class PlannedStepJson(Output):
    """A planned indentation; bands hold 90 % and are those of an identified finger."""

    index: int
    indentor: Shape
    x_mm: float
    target: Literal["doi_mm", "force_gwt"]
    value: float
    unit: Literal["mm", "gwt"]
    increments: int
    hold_s: float
    doi_mm: float
    force_gwt: float
    force_band_gwt: NotRequired[Range]
    doi_band_mm: NotRequired[Range]
    highest_gwt: NotRequired[float]
    contact_area_mm2: float
    mean_pressure_kpa: float
    peak_pressure_kpa: float
    overshoot_gwt: float
    ramp_mm_s: NotRequired[float]
    """Speed of a ramp. The force limits below hold for the predicted stiffness."""
    ramp_fastest_mm_s: NotRequired[float]
    ramp_stop_mm: NotRequired[float]
    """Stopping distance, with the delays of sensor, reading and controller."""
    ramp_trip_gwt: NotRequired[float]
    ramp_bound_gwt: NotRequired[float]
    """Soft trip and overshoot of a press, which the ramp does not exceed either."""


class PressSpeedJson(Output):
    """Press speed that the force sensor allows, age of a sample, and highest rise of the force in it."""

    sample_age_s: float
    press_speed_mm_s: float
    rise_gwt: float


class PossiblePressesJson(Output):
    """Presses that the script may choose as it runs."""

    presses: int
    peak_force_gwt: float
    peak_pressure_kpa: float
    soft_trip_n: float


class FiringSpeedJson(Output):
    """Slowest press at which the most sensitive afferent of a class fires; null if at none."""

    model: Name
    afferents: int
    sensitivity: Ratio
    firing_speed_mm_s: float | None
    doi_mm: float
    press_speed_mm_s: float
    silent: bool


class PreflightJson(PressSpeedJson):
    """A plan against the limits."""

    indentations: int
    other_presses: int
    duration_s: float
    contact_s: float
    peak_force_n: float
    peak_force_gwt: float
    small_strain: SmallStrainJson
    peak_pressure_kpa: float
    soft_trip_n: float
    hard_trip_n: float
    margins: MarginsJson
    stop_distance_mm: float
    overshoot_gwt: float
    steps: list[PlannedStepJson]
    possible: NotRequired[PossiblePressesJson]
    firing: NotRequired[list[FiringSpeedJson]]


@dataclass(frozen=True)
class Preflight:
    """Plan, compared with the limits before a motion."""

    plan: Plan
    config: Config
    rehearsed: Rehearsed

    @property
    def trip_gwt(self) -> float:
        """Lowest trip (gwt), except for the pressure limit."""
        limits = self.config.limits
        return min(limits.soft_trip_n, limits.hard_trip_n, self.plan.soft_trip_n) / GWT_N

    @property
    def stopping(self) -> Stopping:
        """Stopping from the fastest press that the limits allow."""
        return Stopping.of(self.config, self.config.limits.max_press_speed_mm_s)

    def as_json(self) -> PreflightJson:
        """Return the fields that `rig check --json` prints."""
        steps = [self._step(index, planned) for index, planned in enumerate(self.plan.indentations)]
        deepest_mm = max(planned.deepest_mm for planned in self.plan.all_presses)
        limits, peak_gwt, speed = self.config.limits, self.plan.peak_force_gwt, press_speed(self.config, self.plan)
        return {
            "indentations": len(steps),
            "other_presses": sum(map(len, self.plan.presses.values())) - len(steps),
            "duration_s": self.rehearsed.duration_s,
            "contact_s": self.rehearsed.contact_s,
            "peak_force_n": peak_gwt * GWT_N,
            "peak_force_gwt": peak_gwt,
            "small_strain": _small_strain(self.config.finger, deepest_mm).as_json(),
            "peak_pressure_kpa": max(step["peak_pressure_kpa"] for step in steps),
            "soft_trip_n": min(limits.soft_trip_n, self.plan.soft_trip_n),
            "hard_trip_n": limits.hard_trip_n,
            "margins": {
                "force_gwt": self.trip_gwt - peak_gwt,
                "doi_mm": min(limits.max_doi_mm - planned.deepest_mm for planned in self.plan.indentations),
                "mean_pressure_kpa": min(limits.max_pressure_kpa - step["mean_pressure_kpa"] for step in steps),
                "contact_s": limits.max_contact_s - self.rehearsed.contact_s,
            },
            "sample_age_s": speed["sample_age_s"],
            "press_speed_mm_s": speed["press_speed_mm_s"],
            "rise_gwt": speed["rise_gwt"],
            "stop_distance_mm": self.stopping.distance_mm,
            "overshoot_gwt": max(step["overshoot_gwt"] for step in steps),
            "steps": steps,
        }

    def _step(self, index: int, planned: PlannedIndentation) -> PlannedStepJson:
        found: PlannedStepJson = {
            "index": index,
            "indentor": planned.indentor,
            "x_mm": planned.x_mm,
            "target": planned.target.kind,
            "value": planned.target.value,
            "unit": "mm" if planned.target.kind == "doi_mm" else "gwt",
            "increments": planned.increments,
            "hold_s": planned.hold_s,
            "doi_mm": planned.predicted_doi_mm,
            "force_gwt": planned.predicted_force_gwt,
            "contact_area_mm2": planned.contact_area_mm2,
            "mean_pressure_kpa": planned.mean_pressure_kpa,
            "peak_pressure_kpa": 1000 * planned.peak_pressure_mpa,
            "overshoot_gwt": self.stopping.overshoot_gwt(
                self.trip_gwt, planned.predicted_force_gwt, planned.predicted_doi_mm
            ),
        }
        if planned.band is not None:
            found["force_band_gwt"], found["doi_band_mm"] = planned.band.force_gwt, planned.band.doi_mm
            found["highest_gwt"] = planned.band.highest_gwt
        bound = ramp_bound(self.plan, self.config, planned)
        if bound is not None:
            found["ramp_mm_s"], found["ramp_fastest_mm_s"] = bound.speed_mm_s, bound.fastest_mm_s
            found["ramp_stop_mm"] = bound.stop_mm
            found["ramp_trip_gwt"], found["ramp_bound_gwt"] = bound.trip_gwt, bound.bound_gwt
        return found


def possible_presses_as_json(plan: Plan, config: Config) -> PossiblePressesJson:
    """Return how many presses a script may choose, their highest force and pressure, and the soft trip."""
    return {
        "presses": len(plan.allowed),
        "peak_force_gwt": max(press.highest_gwt for press in plan.allowed),
        "peak_pressure_kpa": 1000 * max(press.peak_pressure_mpa for press in plan.allowed),
        "soft_trip_n": min(plan.soft_trip_n, config.limits.soft_trip_n),
    }


def press_speed(config: Config, plan: Plan) -> PressSpeedJson:
    """Return the press speed that the force sensor allows to a plan with presses."""
    age, speeds = SampleAge.of(config), plan.all_speeds_mm_s
    return {
        "sample_age_s": age.age_s,
        "press_speed_mm_s": max(age.press_speed_mm_s(speed_mm_s) for speed_mm_s, _ in speeds),
        "rise_gwt": max(
            age.rise_gwt(speed_mm_s, CONTACT_EXPONENT * planned.highest_gwt / planned.predicted_doi_mm)
            for speed_mm_s, planned in speeds
        ),
    }


def press_speed_in_words(found: PressSpeedJson) -> str:
    """Return the result of `press_speed` as a sentence."""
    return (
        f"the sensor is read after each increment: press at most {found['press_speed_mm_s']:.2g} mm/s; a sample "
        f"is up to {found['sample_age_s']:g} s old, in which the force may rise by {found['rise_gwt']:.3g} gwt"
    )


def preflight(script: Script, config: Config, finger: "Fingertip", plan: Plan) -> Preflight:
    """Rehearse a plan and compare it with the limits. Raises EngineError."""
    return Preflight(plan, config, rehearsed(script, config, finger, plan))


Lines = dict[str, str]


@dataclass(frozen=True)
class Page:
    """Summary of a session: its rehearsal or the error instead, and the duration of rehearsing (s)."""

    session: Session
    rehearsal: Rehearsed | EngineError
    took_s: float

    @classmethod
    def of(cls, session: Session) -> "Page":
        """Rehearse a session on springs; nothing moves."""
        began = time.perf_counter()
        found: Rehearsed | EngineError
        try:
            found = rehearsed(session.script, session.config, session.finger, session.plan, session.before)
        except EngineError as error:
            found = error
        return cls(session, found, time.perf_counter() - began)

    @property
    def lines(self) -> Lines:
        """Lines to print, by label."""
        session, config = self.session, self.session.config
        stage, force = config.stage, config.force
        return {
            "protocol": f"{session.script.title} ({session.script.path.name})",
            "subject": session.into.subject or "none given",
            "devices": f"{stage.kind} on {' and '.join(stage_ports(stage))}, {force.kind} on {force.port}",
            "steps": self._steps,
            "duration": self._duration,
            "force": self._force,
            "trips": f"soft {in_both_units(self._soft_trip_n)}, hard {in_both_units(config.limits.hard_trip_n)}",
            **self.speed,
            **self._ramps,
            **self._pulses,
            "first": self._first,
            "safety": "check that the emergency stop is in reach and the finger is clear of the indentor",
        }

    @property
    def _pulses(self) -> Lines:
        sync = self.session.config.sync
        if sync.output == "off":
            return {}
        return {"pulses": f"{sync.name}, {1000 * sync.width_s:g} ms each, for every press that is data"}

    @property
    def speed(self) -> Lines:
        """Line about the press speed that the force sensor allows, if there is a press."""
        if not self._plan.speeds_mm_s:
            return {}
        return {"speed": press_speed_in_words(press_speed(self.session.config, self._plan))}

    @property
    def _plan(self) -> Plan:
        return self.session.plan

    @property
    def _soft_trip_n(self) -> float:
        limits = self.session.config.limits
        return min(limits.soft_trip_n, limits.hard_trip_n, self._plan.soft_trip_n)

    @property
    def _steps(self) -> str:
        presses = self._plan.presses
        counts = [(len(presses["data"]), "indentations"), (len(self._plan.touches), "touches")]
        counts += [
            (len(presses["precondition"]), "preconditioning presses"),
            (len(presses["reference"]), "references"),
        ]
        summary = ", ".join(number_of(*one) for one in counts if one[0]) or "nothing to press"
        before, allowed = self.session.before, self._plan.allowed
        if allowed:
            summary += f" planned; each is chosen from {number_of(len(allowed), 'checked presses')}"
        return (
            summary
            if before is None
            else f"{summary}, the rest of {before.start['planned_indentations']} planned indentations"
        )

    @property
    def _duration(self) -> str:
        cost = f"rehearsed on a spring model in {self.took_s:.1f} s"
        if isinstance(self.rehearsal, EngineError):
            return f"unknown ({cost}; the rehearsal failed: {self.rehearsal})"
        found = self.rehearsal
        return f"about {found.duration_s:.0f} s, of which {found.contact_s:.0f} s in contact ({cost})"

    @property
    def _force(self) -> str:
        peak_n = self._plan.peak_force_gwt * GWT_N
        identified = self.session.config.identified
        band = (
            ""
            if identified is None
            else f", the upper end of the band for the finger identified on {identified.date} from "
            f"{number_of(identified.presses, 'presses')}"
        )
        below = f"{in_both_units(self._soft_trip_n - peak_n)} below the trip"
        return f"predicted peak {in_both_units(peak_n)}{band}, {below}{self._small_strain}"

    @property
    def _small_strain(self) -> str:
        depths = [planned.deepest_mm for planned in self._plan.all_presses]
        return f"; {_small_strain(self.session.config.finger, max(depths)).note}" if depths else ""

    @property
    def _ramps(self) -> Lines:
        """Force limits of all ramps, if there are any."""
        planned = (ramp_bound(self._plan, self.session.config, press) for press in self._plan.all_presses)
        bounds = [bound for bound in planned if bound is not None]
        if not bounds:
            return {}
        return {
            "ramps": f"{len(bounds)} at up to {max(one.speed_mm_s for one in bounds):g} mm/s, tripped from "
            f"{in_both_units(min(one.trip_gwt for one in bounds) * GWT_N)} on, at rest within "
            f"{max(one.stop_mm for one in bounds):.2g} mm and below "
            f"{in_both_units(max(one.bound_gwt for one in bounds) * GWT_N)}"
        }

    @property
    def _first(self) -> str:
        """First motions of every script: homing, and the way to the first position."""
        config = self.session.config
        chosen, presses = bool(self._plan.allowed), self._plan.all_presses
        shapes = list(dict.fromkeys(planned.indentor for planned in presses))
        shapes = shapes if chosen else shapes[:1]
        by_hand = f"you mount {' or '.join(map(with_size, shapes))}; " if shapes else ""
        if chosen:
            places = [planned.x_mm for planned in presses]
            to = f"; then the stage moves to an x from {min(places):g} to {max(places):g} mm and down to"
        elif presses:
            to = f"; then the stage moves to x = {presses[0].x_mm:g} mm and down to"
        else:
            to = "; then the stage goes no lower than"
        return (
            f"{by_hand}homing lifts the indentor to its switch before any lateral motion{to} "
            f"{config.habits.clearance_mm:g} mm above the finger"
        )


def in_both_units(force_n: float) -> str:
    """Return a force in newtons and gram-weight, as text."""
    return f"{force_n:.3g} N ({force_n / GWT_N:.4g} gwt)"


def _small_strain(finger: FingertipConfig, doi_mm: float) -> SmallStrain:
    return small_strain("finger", doi_mm, finger.tissue.finite_stiffening, compared=is_default_finger(finger))
