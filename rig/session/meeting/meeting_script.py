"""A meeting as a script of the usual verbs: mount, home, zero, then one press after another as it is told."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from rig.data import read_run
from rig.engine import Engine, LimitError
from rig.engine.limits import Trips
from rig.protocol.api import ProtocolParameters, Rig
from rig.protocol.script import Script
from rig.protocol.steps import Indent, Step
from rig.protocol.walk import Spot, Walk
from rig.session.live import Live
from rig.session.meeting.journalled_press import given_press
from rig.session.meeting.meeting import Meeting, Told
from sim.models.meeting.next_press import PressAt

E = TypeVar("E")
A = TypeVar("A")


class MeetingScript:
    """Carries a meeting out; `folder` is where its journal is, once that has begun."""

    def __init__(self, meeting: Meeting, say: Callable[[Told], None] = lambda told: None) -> None:
        self.meeting, self._say = meeting, say
        self.folder: Path | None = None
        self._pressing: PressAt | None = None

    def as_script(self) -> Script:
        """For a session."""
        title = "Meeting a finger"
        return Script(Path(__file__), "meet", title, "docs/meet.md", ProtocolParameters(), self.run)

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
                rig.home()
                rig.zero()
            mounted = press.indentor
            rig.move_to(x_mm=press.x_mm)
            self._press(rig, press)

    def _press(self, rig: Rig, press: PressAt) -> None:
        """One that would go beyond the trip has told as much as it did."""
        try:
            rig.indent(doi_mm=press.doi_mm, hold_s=self.meeting.wanted.hold_s)
        except LimitError as error:
            rig.note(f"press cut short: {error}")
        assert self.folder is not None
        run = read_run(self.folder)
        given = given_press(run, run.stream("indentation_start")[-1]["index"], self.meeting.settings)
        if given is None:
            raise LimitError("the press was cut short before it told anything")
        told = self.meeting.take(press, given)
        rig.note(json.dumps(_noted(told)))
        self._say(told)


def _noted(told: Told) -> dict[str, float | list[float]]:
    """What the journal keeps of what was learned."""
    foreseen = told.surprise.foreseen
    return {
        "press": told.number,
        "foreseen_gwt": [round(one, 4) for one in (foreseen.low, foreseen.middle, foreseen.high)],
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
