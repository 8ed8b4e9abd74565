"""What `rig check` says before anything moves: steps, duration, predicted forces and pressures, margins, stopping."""

from dataclasses import dataclass
from typing import Any

from rig.devices.units import GWT_N
from rig.engine.stopping import Stopping
from rig.plan.config import Config
from rig.plan.plan import Plan
from rig.protocol.planned import PlannedIndentation
from rig.protocol.script import Script
from rig.session.rehearsal import Rehearsed, rehearsed
from sim.models.fingertip import Fingertip
from sim.models.small_strain import small_strain


@dataclass(frozen=True)
class Preflight:
    """A plan held against the limits; nothing has moved for it."""

    plan: Plan
    config: Config
    rehearsed: Rehearsed

    @property
    def trip_gwt(self) -> float:
        """The force that would trip, the contact's area aside."""
        limits = self.config.limits
        return min(limits.soft_trip_n, limits.hard_trip_n, self.plan.soft_trip_n) / GWT_N

    @property
    def stopping(self) -> Stopping:
        """How the stage stops from the fastest press that the limits allow."""
        return Stopping.of(self.config, self.config.limits.max_press_speed_mm_s)

    def as_json(self) -> dict[str, Any]:
        """What `rig check --json` prints."""
        steps = [self._step(index, planned) for index, planned in enumerate(self.plan.indentations)]
        deepest_mm = max(planned.deepest_mm for planned in self.plan.all_presses)
        limits, peak_gwt = self.config.limits, self.plan.peak_force_gwt
        return {
            "indentations": len(steps),
            "other_presses": len(self.plan.all_presses) - len(steps),
            "duration_s": self.rehearsed.duration_s,
            "contact_s": self.rehearsed.contact_s,
            "peak_force_n": peak_gwt * GWT_N,
            "peak_force_gwt": peak_gwt,
            "small_strain": small_strain("finger", deepest_mm, self.config.finger.tissue.stiffening).as_json(),
            "peak_pressure_n_cm2": max(step["peak_pressure_n_cm2"] for step in steps),
            "soft_trip_n": min(limits.soft_trip_n, self.plan.soft_trip_n),
            "hard_trip_n": limits.hard_trip_n,
            "margins": {
                "force_gwt": self.trip_gwt - peak_gwt,
                "doi_mm": min(limits.max_doi_mm - planned.deepest_mm for planned in self.plan.indentations),
                "mean_pressure_n_cm2": min(limits.max_pressure_n_cm2 - step["mean_pressure_n_cm2"] for step in steps),
                "contact_s": limits.max_contact_s - self.rehearsed.contact_s,
            },
            "stop_distance_mm": self.stopping.distance_mm,
            "overshoot_gwt": max(step["overshoot_gwt"] for step in steps),
            "steps": steps,
        }

    def _step(self, index: int, planned: PlannedIndentation) -> dict[str, Any]:
        return {
            "index": index,
            "indentor": planned.indentor,
            "x_mm": planned.x_mm,
            "target": planned.target.kind,
            "value": planned.target.value,
            "increments": planned.increments,
            "hold_s": planned.hold_s,
            **_band(planned),
            "doi_mm": planned.predicted_doi_mm,
            "force_gwt": planned.predicted_force_gwt,
            "contact_area_mm2": planned.contact_area_mm2,
            "mean_pressure_n_cm2": planned.mean_pressure_n_cm2,
            "peak_pressure_n_cm2": 100 * planned.peak_pressure_mpa,
            "overshoot_gwt": self.stopping.overshoot_gwt(
                self.trip_gwt, planned.predicted_force_gwt, planned.predicted_doi_mm
            ),
        }


def _band(planned: PlannedIndentation) -> dict[str, Any]:
    """Of a finger that was met."""
    if planned.band is None:
        return {}
    force, depth = planned.band.force_gwt, planned.band.doi_mm
    return {"force_band_gwt": list(force), "doi_band_mm": list(depth), "highest_gwt": planned.band.highest_gwt}


def preflight(script: Script, config: Config, finger: Fingertip, plan: Plan) -> Preflight:
    """Rehearse a plan for its duration and hold it against the limits. Raises EngineError."""
    return Preflight(plan, config, rehearsed(script, config, finger, plan))
