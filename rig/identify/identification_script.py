"""A meeting as a script of the usual verbs: mount, home, zero, then one press after another as it is told."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from rig.data import RunFolder
from rig.data.folder import SCRIPT
from rig.data.run import Events, Following, add_event
from rig.engine import Engine, LimitError
from rig.engine.limits import Trips
from rig.identify.adaptive_presses import Meeting, PressReport
from rig.identify.press_record import given_press
from rig.protocol.api import ProtocolParameters, Rig
from rig.protocol.check import Spot, Walk
from rig.protocol.script import Script
from rig.protocol.steps import Indent, Step
from rig.session.execute import Live
from sim.identification.next_press import PressAt

E = TypeVar("E")
A = TypeVar("A")


def as_script(run: Callable[[Rig], None]) -> Script:
    """A meeting as a script, whatever runs it."""
    path, title = Path(__file__).with_name(SCRIPT), "Identification of a finger"
    return Script(path, "identify", title, "docs/identify.md", ProtocolParameters(), run)


class MeetingScript:
    """Carries a meeting out. What its presses gave it reads in its journal, once it is told that this has begun."""

    def __init__(
        self,
        meeting: Meeting,
        say: Callable[[PressReport], None] = lambda told: None,
        say_before: Callable[[PressAt | None], None] = lambda press: None,
    ) -> None:
        """say: of each press, when it was learned from; say_before: which comes now, None while the stage homes."""
        self.meeting, self._say, self._say_before = meeting, say, say_before
        self._pressing: PressAt | None = None
        self._journal: Following | None = None
        self._events: Events = {}

    def begins(self, folder: RunFolder) -> None:
        """From now on presses can be read back."""
        self._journal = Following(folder)

    def as_script(self) -> Script:
        """For a session."""
        return as_script(self.run)

    def handler(self, engine: Engine, walk: Walk) -> "Tripping":
        """What carries its steps out."""
        return Tripping(engine, walk, self)

    @property
    def trip_n(self) -> float | None:
        """Of the press that comes now."""
        return None if self._pressing is None else self.meeting.trip_n(self._pressing)

    def run(self, rig: Rig) -> None:
        """Press until enough is known."""
        mounted: str | None = None
        while not self.meeting.enough:
            press = self._pressing = self.meeting.next()
            if press.indentor != mounted:
                rig.mount(press.indentor)
            if mounted is None:
                self._say_before(None)
                rig.home()
            mounted = press.indentor
            self._say_before(press)
            rig.move_to(x_mm=press.x_mm)
            rig.zero()
            self._press(rig, press)

    def _press(self, rig: Rig, press: PressAt) -> None:
        """One that would go beyond the trip has told as much as it did."""
        begun = self._begun()
        try:
            rig.indent(doi_mm=press.doi_mm, hold_s=self.meeting.wanted.hold_s)
        except LimitError as error:
            if self._begun() == begun:
                raise
            rig.note(f"press ended early: {error}")
        given = given_press(self._events, self._begun()[-1], self.meeting.settings)
        if given is None:
            raise LimitError("the press ended before it gave enough readings", code="press_cut_short")
        told = self.meeting.take(press, given)
        rig.note(json.dumps(_noted(told)))
        self._say(told)

    def _begun(self) -> list[int]:
        """The numbers of the presses that the journal has by now."""
        assert self._journal is not None
        for document in self._journal.new():
            add_event(self._events, document)
        return [start["index"] for start in self._events.get("indentation_start", [])]


def _noted(told: PressReport) -> dict[str, float | list[float]]:
    """What the journal keeps of what was learned."""
    foreseen = told.surprise.foreseen
    return {
        "press": told.number,
        "predicted_gwt": [round(one, 4) for one in (foreseen.low, foreseen.middle, foreseen.high)],
        "measured_gwt": round(told.surprise.measured_gwt, 4),
        "half_width": round(told.widest, 4),
    }


class Tripping(Live):
    """Before each press the soft trip is what is known now."""

    def __init__(self, engine: Engine, walk: Walk, script: MeetingScript) -> None:
        super().__init__(engine, walk)
        self._script = script

    def handle(self, step: Step[E, A], spot: Spot) -> A:
        """What the engine found."""
        if isinstance(step, Indent):
            self._engine.trips = Trips(self._engine.settings.limits, self._script.trip_n)
        return super().handle(step, spot)
