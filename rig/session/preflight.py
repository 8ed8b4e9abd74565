"""What is read and confirmed before anything real moves: one page on a run."""

import time
from dataclasses import dataclass

from rig.devices.units import GWT_N
from rig.engine import EngineError
from rig.plan.plan import Plan
from rig.session.rehearsal import Rehearsed, rehearsed
from rig.session.session import Session
from sim.models.small_strain import small_strain

Lines = dict[str, str]


@dataclass(frozen=True)
class Page:
    """A session that is to begin, and its rehearsal or why it has none; `took_s` is what rehearsing cost."""

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
        """What each line is about, and its words."""
        session, config = self.session, self.session.config
        stage, force = config.stage, config.force
        return {
            "protocol": f"{session.script.title} ({session.script.path.name})",
            "subject": session.into.subject or "none given",
            "devices": f"{stage.kind} on {' and '.join(stage.ports)}, {force.kind} on {force.port}",
            "steps": self._steps,
            "duration": self._duration,
            "force": self._force,
            "trips": f"soft {_both(self._soft_trip_n)}, hard {_both(config.limits.hard_trip_n)}",
            "first": self._first,
            "safety": "is the emergency stop in reach, the finger clear of the indentor?",
        }

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
        counts = {"indentations": len(presses["data"]), "touches": len(self._plan.touches)}
        counts |= {"preconditioning presses": len(presses["precondition"]), "references": len(presses["reference"])}
        told = ", ".join(f"{number} {what}" for what, number in counts.items() if number) or "nothing to press"
        before = self.session.before
        return (
            told
            if before is None
            else f"{told}: what is missing of {before.start['planned_indentations']} indentations"
        )

    @property
    def _duration(self) -> str:
        cost = f"rehearsed on springs in {self.took_s:.1f} s"
        if isinstance(self.rehearsal, EngineError):
            return f"not known: {cost}, it ended with {self.rehearsal}"
        found = self.rehearsal
        return f"about {found.duration_s:.0f} s, the finger touched for {found.contact_s:.0f} s of them ({cost})"

    @property
    def _force(self) -> str:
        peak_n = self._plan.peak_force_gwt * GWT_N
        met = self.session.config.met
        band = "" if met is None else f", the upper end for the finger met on {met.date} in {met.presses} presses"
        below = f"{_both(self._soft_trip_n - peak_n)} below the trip"
        return f"predicted peak {_both(peak_n)}{band}, {below}{self._small_strain}"

    @property
    def _small_strain(self) -> str:
        depths = [planned.deepest_mm for planned in self._plan.all_presses]
        stiffening = self.session.config.finger.tissue.stiffening
        return f"; {small_strain('finger', max(depths), stiffening).note}" if depths else ""

    @property
    def _first(self) -> str:
        """What moves first, whatever the script: homing, and on the way down to the first place."""
        config = self.session.config
        mounted = next(iter(dict.fromkeys(planned.indentor for planned in self._plan.all_presses)), None)
        by_hand = "" if mounted is None else f"you mount {mounted}; "
        places = [planned.x_mm for planned in self._plan.all_presses]
        to = f", then to x = {places[0]:g} mm and down to" if places else ", and no lower than"
        return (
            f"{by_hand}homing, the indentor up to its switch before anything moves sideways{to} "
            f"{config.habits.clearance_mm:g} mm above the finger"
        )


def _both(force_n: float) -> str:
    return f"{force_n:.3g} N ({force_n / GWT_N:.4g} gwt)"
