"""Identification as a script: mount, home, zero, then the presses that the identification chooses."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from rig.data import RunFolder
from rig.data.folder import SCRIPT
from rig.data.run import Event, Following
from rig.engine import Engine, LimitError
from rig.engine.limits import CONTACT_EXPONENT, FingerStiffness, Trips
from rig.identify.adaptive_presses import Identification, PressReport
from rig.identify.press_record import measured_press
from rig.protocol.api import ProtocolParameters, Rig
from rig.protocol.check import PressPlace, ScriptState
from rig.protocol.script import Script
from rig.protocol.steps import ResumeRule, Step
from sim.identification.next_press import PressAt


def as_script(run: Callable[[Rig], None]) -> Script:
    """Return a script of an identification that executes `run`."""
    path, title = Path(__file__).with_name(SCRIPT), "Identification of a finger"
    return Script(path, "identify", title, "docs/identify.md", ProtocolParameters(), run)


@dataclass(frozen=True, kw_only=True)
class LimitPress(Step[None, None]):
    """Set the soft trip (N) of the next press, and the highest likely stiffness under it."""

    verb: ClassVar[str] = "limit_press"
    on_resume: ClassVar[ResumeRule] = ResumeRule.LAST

    soft_trip_n: float | None
    stiffness: FingerStiffness

    def check(self, state: ScriptState) -> PressPlace:
        return state.place()

    def execute(self, engine: Engine, expected: None) -> None:
        engine.trips = Trips(engine.settings.limits, self.soft_trip_n)
        engine.stiffness = self.stiffness


class IdentificationScript:
    """Script of an identification, which reads the measurements of its presses from the journal."""

    def __init__(
        self,
        identification: Identification,
        say: Callable[[PressReport], None] = lambda report: None,
        say_before: Callable[[PressAt | None], None] = lambda press: None,
    ) -> None:
        """Prepare the script. say: called after each press. say_before: called before each press, with None before
        homing.
        """
        self.identification, self._say, self._say_before = identification, say, say_before
        self._journal: Following | None = None
        self._events: dict[str, list[Event]] = {}

    def begins(self, folder: RunFolder) -> None:
        """Open the journal of the run, from which presses are read."""
        self._journal = Following(folder)

    def as_script(self) -> Script:
        """Return the script for a session."""
        return as_script(self.run)

    def run(self, rig: Rig) -> None:
        """Press until the identification is finished."""
        mounted: str | None = None
        while not self.identification.enough:
            press = self.identification.next()
            if press.indentor != mounted:
                rig.mount(press.indentor)
            if mounted is None:
                self._say_before(None)
                rig.home()
            mounted = press.indentor
            self._say_before(press)
            highest_gwt = self.identification.highest_gwt(press)
            stiffness = FingerStiffness(highest_gwt / press.doi_mm**CONTACT_EXPONENT)
            rig.do(LimitPress(soft_trip_n=self.identification.trip_n(press), stiffness=stiffness))
            rig.move_to(x_mm=press.x_mm)
            rig.zero()
            self._press(rig, press)

    def _press(self, rig: Rig, press: PressAt) -> None:
        """Do one press; a press that a trip ended counts with its readings up to the trip."""
        begun = self._begun()
        try:
            rig.indent(doi_mm=press.doi_mm, hold_s=self.identification.options.hold_s)
        except LimitError as error:
            if self._begun() == begun:
                raise
            rig.note(f"press ended early: {error}")
        measured = measured_press(self._events, self._begun()[-1], self.identification.settings)
        if measured is None:
            raise LimitError("the press ended before it gave enough readings", "press_cut_short")
        report = self.identification.take(press, measured)
        rig.note(json.dumps(_noted(report)))
        self._say(report)

    def _begun(self) -> list[int]:
        """Return the indices of the presses in the journal so far."""
        assert self._journal is not None
        for document in self._journal.new():
            if document["doc"] == "event":
                event = {"t_s": document["t_s"], **document["data"]}
                self._events.setdefault(document["stream"], []).append(event)
        return [start["index"] for start in self._events.get("indentation_start", [])]


def _noted(report: PressReport) -> dict[str, float | list[float]]:
    """Return the content of the note in the journal."""
    predicted = report.surprise.predicted
    return {
        "press": report.number,
        "predicted_gwt": [round(one, 4) for one in (predicted.low, predicted.middle, predicted.high)],
        "measured_gwt": round(report.surprise.measured_gwt, 4),
        "half_width": round(report.widest, 4),
    }
