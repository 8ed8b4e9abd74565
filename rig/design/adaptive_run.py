"""Run of a designed script in which each press is chosen after the count of the one before.

The presses are those of any script: verbs, with the same checks, carried out by the same executors. Only one step is
new, the choice. It waits at clearance, and it can only return a press that was checked before the first motion.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any, ClassVar, TypeVar

from rig.clock import WallClock
from rig.data import Run
from rig.data.choices import BY_PLAN, PLAN_DONE, probabilities_of
from rig.data.events import AlarmEvent, ChoiceEvent
from rig.data.run_state import UNTIL_CHOSEN, Course
from rig.design.adaptive import SpikeCount
from rig.design.chooser import ChooserLostError, Choosing, Decision, NextPressChooser, probabilities_as_text
from rig.design.designed import Designed
from rig.design.press_times import in_memory
from rig.design.presses import PossiblePress
from rig.engine import Engine, verbs
from rig.errors import BadInputError, CountError
from rig.plan.plan import Plan, make_plan
from rig.protocol.api import Rig
from rig.protocol.check import Spot, Walk
from rig.protocol.script import Script
from rig.protocol.steps import Owed, Step
from rig.session.session import Session
from sim.finger_process import Finger

E = TypeVar("E")
A = TypeVar("A")

LOOK_S = 0.005

CHOICE_WITHIN_S = 10.0
"""Longest wait for a choice that needs no count (s)."""


@dataclass(frozen=True, kw_only=True)
class ChoosePress(Step[None, int | None]):
    """Wait at clearance for the count of the last press, and choose the next one; None ends the presses."""

    verb: ClassVar[str] = "choice"
    owed: ClassVar[Owed] = Owed.ONCE

    index: int
    last: int | None
    planned: int | None
    of: "AdaptiveRun"

    def check(self, walk: Walk) -> Spot:
        return walk.spot()

    def foreseen(self, expected: None) -> int | None:
        return self.planned

    def execute(self, engine: Engine, expected: None) -> int | None:
        return self.of.choose(engine, self)

    def rehearse(self, engine: Engine, expected: None) -> int | None:
        return self.planned


@dataclass(eq=False)
class AdaptiveRun:
    """Presses of an adaptive run: first those in the journal of `before`, then chosen or planned ones.

    A count is awaited for at most `within_s`.
    """

    script: Script
    designed: Designed
    choosing: Choosing
    within_s: float
    open_chooser: Callable[[Choosing], NextPressChooser]
    before: Run | None = None
    approved: Plan = field(default_factory=Plan)  # every press that may be chosen
    _chooser: NextPressChooser | None = field(default=None, init=False)
    _truth: Mapping[str, Any] | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        candidates = self.choosing.request.candidates
        for one in self.recorded:
            self._refuse_changed(one)
        self._probabilities = tuple(probabilities_of(self.recorded[-1]).values()) if self.recorded else ()
        self._probabilities = self._probabilities or (1 / len(candidates),) * len(candidates)

    def _refuse_changed(self, choice: Mapping[str, Any]) -> None:
        """Raise BadInputError if the number of a recorded press now names another one, or none."""
        number = choice.get("possible")
        if number is None:
            return
        press = PossiblePress(choice["indentor"], choice["x_mm"], choice["target"], choice["value"])
        if not 0 <= number < len(self.presses) or self.presses[number] != press:
            raise BadInputError(
                f"choice {choice['index']} of the stopped run, {press.title}, is no longer press {number} of "
                "those that may be chosen: the journal, the finger or this program changed; start a new run",
                "choice_changed",
            )

    @cached_property
    def recorded(self) -> list[Mapping[str, Any]]:
        """Choices in the journal."""
        return [] if self.before is None else list(self.before.stream("choice"))

    @cached_property
    def presses(self) -> Sequence[PossiblePress]:
        """Presses that may be chosen."""
        return self.choosing.table.presses

    @cached_property
    def planned(self) -> list[int]:
        """Numbers of the planned presses, without those beyond the limits."""
        number = {press: k for k, press in enumerate(self.presses)}
        return [number[press] for press in self.designed.planned if press in number]

    def as_script(self) -> Script:
        """Return the script that carries out the choices."""
        return replace(self.script, run=self.run, texts=None)

    def run(self, rig: Rig) -> None:
        """Make presses until there is nothing to choose."""
        parameters, made, mounts, shape = self.choosing.request, list[int](), 0, None
        while True:
            index, last = len(made), made[-1] if made else None
            planned = self._planned_after(made, shape)
            possible = rig.do(ChoosePress(index=index, last=last, planned=planned, of=self))
            if index < len(self.recorded):
                found = self.recorded[index].get("possible")
                possible = None if found is None else int(found)
            if possible is None:
                return
            press = self.presses[possible]
            if press.shape != shape:
                shape, mounts = press.shape, mounts + 1
                rig.mount(shape)
                if mounts == 1:
                    rig.home()
                rig.checkpoint(f"indentor {mounts}: {shape}")
                rig.zero()
            press.make(rig, parameters.hold_s)
            rig.rest(parameters.rest_s)
            made.append(possible)

    def _planned_after(self, made: Sequence[int], shape: str | None) -> int | None:
        """Return the next press of the plan that was not made, with the mounted shape first."""
        left = list(self.planned)
        for one in made:
            with suppress(ValueError):
                left.remove(one)
        if not left or len(made) >= len(self.planned):
            return None
        return next((one for one in left if self.presses[one].shape == shape), left[0])

    # --- around the run ---

    @property
    def about(self) -> dict[str, Any]:
        """Record of the choice for the journal and the run folder."""
        return {
            "source": self.choosing.source,
            "within_s": self.within_s,
            "candidates": list(self.choosing.request.candidates),
            "possible_presses": len(self.presses),
            "truth": None if self._truth is None else dict(self._truth),
        }

    def opened(self) -> "AdaptiveRun":
        """Open the source, unless the run already follows the plan. Raises CountError before a motion."""
        if not any(one["reason"] in (BY_PLAN, PLAN_DONE) for one in self.recorded):
            self._chooser = self.open_chooser(self.choosing)
            self._truth = self._chooser.truth
        return self

    def close(self) -> None:
        """End the source."""
        chooser, self._chooser = self._chooser, None
        if chooser is not None:
            chooser.close()

    def applied(self, session: Session) -> Session:
        """Return the session with the choice, and with the soft trip of all presses that may be chosen."""
        trip_n = max(self.approved.soft_trip_n, session.plan.soft_trip_n)
        before = session.plan.first_soft_trip_n
        files = {**session.plan.shape_files, **self.approved.shape_files}
        plan = replace(session.plan, first_soft_trip_n=trip_n if before is None else before, shape_files=files)
        return replace(session, plan=plan, chooses=self.about, possible=self.approved)

    @staticmethod
    def course(planned: Course) -> Course:
        """Return the course of a run whose presses are chosen as it proceeds."""
        words = {name: UNTIL_CHOSEN.get(name[0], text) for name, text in planned.words.items()}
        return replace(planned, words=words)

    # --- the choice, at clearance ---

    def choose(self, engine: Engine, step: ChoosePress) -> int | None:
        """Return the next press, journalled with its reason; None ends the presses."""
        found = None
        if self._chooser is not None:
            try:
                found = self._chosen(engine, self._chooser, step)
            except ChooserLostError as error:
                self._go_by_plan(engine, step, str(error))
            if found is None and self._chooser is not None:
                self._go_by_plan(engine, step, self._late(step))
        if found is None:
            reason = PLAN_DONE if step.planned is None else BY_PLAN
            found = Decision(None, step.planned, reason, None, self._probabilities, 0.0)
        self._probabilities = found.probabilities
        self._record(engine, step, found)
        return found.possible

    def _late(self, step: ChoosePress) -> str:
        if step.last is None:
            return f"no choice of the first press within {CHOICE_WITHIN_S:g} s"
        return f"no count of press index {step.index - 1} within {self.within_s:g} s"

    def _go_by_plan(self, engine: Engine, step: ChoosePress, why: str) -> None:
        """Continue with the plan, and report it in journal, output, panel and report."""
        self.close()
        engine.record(AlarmEvent(f"{why}; from press index {step.index} on, the run follows the plan"))

    def _chosen(self, engine: Engine, chooser: NextPressChooser, step: ChoosePress) -> Decision | None:
        """Wait for the choice; None if the count does not arrive in time. Raises CountError."""
        clock = WallClock()
        chooser.begin(step.last)
        until_s = clock.monotonic_s() + (CHOICE_WITHIN_S if step.last is None else self.within_s)
        look = verbs.LooksAtClearance(engine, clock)
        while not chooser.is_ready():
            began_s = clock.monotonic_s()
            verbs.safe_point(engine)
            now_s = clock.monotonic_s()
            until_s += now_s - began_s  # A pause of the operator does not count.
            if now_s >= until_s:
                return None
            look()
            clock.wait_s(LOOK_S)
        verbs.safe_point(engine)
        found = chooser.decision()
        if found.possible is not None and not 0 <= found.possible < len(self.presses):
            raise CountError(
                f"press {found.possible} was chosen, which is none of the {len(self.presses)} that were checked",
                "press_not_checked",
            )
        return found

    def _record(self, engine: Engine, step: ChoosePress, found: Decision) -> None:
        press = None if found.possible is None else self.presses[found.possible]
        choice = ChoiceEvent(
            index=step.index,
            indentor=None if press is None else press.shape,
            x_mm=None if press is None else press.x_mm,
            target=None if press is None else press.kind,
            value=None if press is None else press.target,
            reason=found.reason,
            count=found.spikes,
            probabilities=probabilities_as_text(self.choosing.request.candidates, found.probabilities),
            information_bits=found.information_bits,
            possible=found.possible,
            chosen_in_s=round(found.chosen_in_s, 6),
        )
        engine.record(choice)


def approved(choosing: Choosing, finger: Finger, folder: Path | None = None) -> Plan:
    """Return the plan of every press that may be chosen. Raises BadInputError for one beyond a limit.

    Each counts as if it were the only one, because a run makes few of them; its total is checked as it presses.
    """
    held_s = choosing.request.hold_s

    def run(rig: Rig) -> None:
        shape = ""
        for press in choosing.table.presses:
            if press.shape != shape:
                rig.mount(press.shape)
                if not shape:
                    rig.home()
                rig.zero()
                shape = press.shape
            rig._walk.held_s = 0.0
            press.make(rig, held_s)

    return make_plan(in_memory(run), choosing.config, finger, None, folder, known=dict(choosing.table.predictions))


def counted_in(run: Run | None) -> tuple[SpikeCount, ...]:
    """Return the presses of a journal whose count was taken in, with it, in order."""
    choices = [] if run is None else run.stream("choice")
    return tuple(
        SpikeCount(int(press["possible"]), None if after["count"] is None else float(after["count"]))
        for press, after in pairwise(choices)
    )


def presses_in(run: Run | None) -> int:
    """Return how many presses of a journal have been chosen and made."""
    return 0 if run is None else len(run.done)
