"""Choice of the presses of a designed script, each after the count of the one before.

The presses are those of any script: verbs, with the same checks, carried out by the same executors. Only one step is
new, the choice. It waits at clearance, and it can only return a press that was checked before the first motion.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NamedTuple
from weakref import WeakKeyDictionary

from pydantic import AfterValidator

from rig.clock import WallClock
from rig.data.choices import BY_PLAN, PLAN_DONE, probabilities_of
from rig.data.events import AlarmEvent, ChoiceEvent, CountSourceEvent
from rig.design.exceptions import DesignError
from rig.design.presses import PossiblePress, planned_presses
from rig.engine import Engine, verbs
from rig.errors import BadInputError, CountError
from rig.plan.config import Config
from rig.plan.finger_model import FingerModel
from rig.protocol.api import Rig
from rig.protocol.check import PressPlace, ScriptState
from rig.protocol.steps import Journalled, ResumeRule, Step
from rig.records import PlannedIndentation
from rig_shared.plural import number_of
from sim.finger_process import Finger

if TYPE_CHECKING:  # A designed script without counts needs none of these.
    from rig.design.chooser import Choosing, Decision, NextPressChooser
    from rig.design.designed import Designed

LOOK_S = 0.005

CHOICE_WITHIN_S = 10.0
"""Longest wait for a choice that needs no count (s)."""


def _absolute(source: str) -> str:
    """Return a source with the absolute path of its file, so that a run of it resumes anywhere."""
    return str(Path(source).absolute()) if source.endswith(".csv") else source


CountsSource = Annotated[str, AfterValidator(_absolute)]
"""Type of the parameter that names the source of the counts."""


@dataclass(frozen=True)
class ChosenPress:
    """Answer of a choice: the next press and its number, or None at the end; why; count of the press before."""

    press: PossiblePress | None
    possible: int | None = None
    reason: str = BY_PLAN
    count: int | None = None
    probabilities: tuple[float, ...] = ()


class ConfiguredFinger(NamedTuple):
    """Configuration and finger model of the pass over a script."""

    config: Config
    model: FingerModel


@dataclass(frozen=True, kw_only=True)
class ChoosePress(Step[ConfiguredFinger, ChosenPress]):
    """Wait at clearance for the count of the last press, and choose the next one; the planned one in a plan."""

    verb: ClassVar[str] = "choice"
    on_resume: ClassVar[ResumeRule] = ResumeRule.ONCE

    index: int
    planned: PossiblePress | None
    chooser: "Chooser" = field(repr=False)

    def check(self, state: ScriptState) -> PressPlace:
        made, chosen = state.pressed["data"], self.chooser.chosen
        if made != chosen:
            raise BadInputError(
                f"{self.verb}: the script made {number_of(made, 'presses')}, of which this chooser chose {chosen}; "
                "counts belong to presses by their index, so press only what one chooser returns, each once",
                "press_not_chosen",
            )
        return state.place()

    def expect(self, place: PressPlace, state: ScriptState) -> ConfiguredFinger:
        assert isinstance(state.settings, Config)
        assert isinstance(state.model, FingerModel)
        return ConfiguredFinger(state.settings, state.model)

    def foreseen(self, expected: ConfiguredFinger) -> ChosenPress:
        return ChosenPress(self.planned, reason=PLAN_DONE if self.planned is None else BY_PLAN)

    def allowed_presses(self, expected: ConfiguredFinger) -> Sequence[PlannedIndentation]:
        return self.chooser.checked_presses(expected)

    def execute(self, engine: Engine, expected: ConfiguredFinger) -> ChosenPress:
        return self.chooser.choose(engine, self, expected)

    def rehearse(self, engine: Engine, expected: ConfiguredFinger) -> ChosenPress:
        choice = self.foreseen(expected)
        engine.record(_event(self.index, choice, "{}"))
        return choice

    @classmethod
    def answers(cls, before: Journalled) -> dict[int, ChosenPress]:
        return dict(enumerate(map(_recorded, before.stream("choice"))))


class Chooser:
    """Presses of a designed script: those that were planned, or those that spike counts choose.

    Parameters
    ----------
    rig : Rig
        Rig of the script.
    design : mapping
        Block `DESIGN` of the script: what the presses are chosen for.
    blocks : sequence
        Block `BLOCKS` of the script: the planned presses.
    hold_s : float
        Hold of each press: the window of the counts (s).
    rest_s : float
        Rest after each press (s).
    counts : str, optional
        Source of the counts: a CSV file, ``lsl:STREAM``, ``virtual:SA1``, ``virtual:MEASURE`` or ``module:function``.
        Without one the planned presses follow in order.
    within_s : float, optional
        Longest wait for a count (s); then the planned presses follow.

    Raises
    ------
    DesignError
        If a block is wrong, or the text names no source.
    ShapeError
        If a shape does not exist.
    """

    def __init__(
        self,
        rig: Rig,
        design: Mapping[str, Any],
        blocks: Sequence[Any],
        *,
        hold_s: float,
        rest_s: float,
        counts: str = "",
        within_s: float = 30.0,
    ) -> None:
        self._rig, self._source, self._within_s = rig, counts, within_s
        self._planned = planned_presses(design, blocks)
        self._design = _designed(design, blocks, counts, hold_s, rest_s) if counts else None
        self._choices: list[ChosenPress] = []
        self._checked = False
        self._choosing: Choosing | None = None
        self._counter: NextPressChooser | None = None

    def __enter__(self) -> "Chooser":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the source of the counts."""
        self.close()

    def close(self) -> None:
        """Close the source of the counts."""
        counter, self._counter = self._counter, None
        if counter is not None:
            counter.close()

    def next(self) -> PossiblePress | None:
        """Return the next press, or None after the last one.

        Returns
        -------
        PossiblePress or None
            Shape, position (mm), and depth (mm) or force (gwt).
        """
        planned = self._planned_next()
        if self._source:
            choice = self._rig.do(ChoosePress(index=len(self._choices), planned=planned, chooser=self))
        else:
            choice = ChosenPress(planned)
        self._choices.append(choice)
        return choice.press

    @property
    def chosen(self) -> int:
        """Number of presses that it has returned."""
        return len(self._made)

    @property
    def _made(self) -> list[PossiblePress]:
        return [choice.press for choice in self._choices if choice.press is not None]

    def _planned_next(self) -> PossiblePress | None:
        """Return the next press of the plan that was not made, with the mounted shape first."""
        made, left = self._made, list(self._planned)
        for press in made:
            with suppress(ValueError):
                left.remove(press)
        if not left or len(made) >= len(self._planned):
            return None
        return next((press for press in left if made and press.shape == made[-1].shape), left[0])

    # --- before the first motion ---

    def checked_presses(self, on: ConfiguredFinger) -> Sequence[PlannedIndentation]:
        """Return every press that may be chosen, once for each pass. Raises BadInputError for one beyond a limit.

        Each counts as if it were the only one, because a run makes few of them; its total is checked as it presses.
        """
        from rig.design.press_times import planned_alone

        if self._checked:
            return ()
        choosing = self._prepared(on)
        choosing.refuse_too_short()
        for number, choice in enumerate(self._choices):
            _refuse_changed(number, choice, choosing.table.presses)
        for press in self._planned:
            if press not in choosing.table.presses:
                raise BadInputError(
                    f"BLOCKS: {press.title} is beyond a limit, or the finger model has no answer at the receptors; "
                    "design the session again",
                    "planned_press_not_possible",
                )
        on.model.learn(choosing.table.predictions)
        planned: list[PlannedIndentation] = []
        for found in planned_alone(on.config, on.model, choosing.table.presses, choosing.request.hold_s):
            if isinstance(found, BadInputError):
                raise found
            planned.append(found)
        self._checked = True
        return planned

    def _prepared(self, on: ConfiguredFinger) -> "Choosing":
        """Return what a choice needs, with the counts so far."""
        from rig.design.adaptive import SpikeCount

        assert self._design is not None
        table = _choosing(self._design, on.config, on.model.finger)
        number = {press: k for k, press in enumerate(table.table.presses)}
        history = tuple(
            SpikeCount(number[press], None if after.count is None else float(after.count))
            for before, after in pairwise(self._choices)
            if (press := before.press) is not None and press in number
        )
        made = len(self._made)
        return replace(table, source=self._source, history=history, made=made)

    # --- the choice, at clearance ---

    def choose(self, engine: Engine, step: ChoosePress, on: ConfiguredFinger) -> ChosenPress:
        """Return the next press, journalled with its reason; None ends the presses."""
        from rig.design.chooser import ChooserLostError, probabilities_as_text

        self.checked_presses(on)  # A script may have swallowed the refusal of the plan.
        self._choosing = self._choosing or self._prepared(on)
        candidates = self._choosing.request.candidates
        decision = None
        if not any(choice.reason in (BY_PLAN, PLAN_DONE) for choice in self._choices):
            counter = self._counter or self._opened(engine, self._choosing)
            try:
                decision = self._counted(engine, counter, len(self._choosing.table.presses))
                late = self._late
            except ChooserLostError as error:
                late = str(error)
            if decision is None:
                self.close()
                engine.record(AlarmEvent(f"{late}; from press index {step.index} on, the run follows the plan"))
        if decision is None:
            choice = self._by_plan(step, self._choosing.table.presses, len(candidates))
        else:
            possible = decision.possible
            press = None if possible is None else self._choosing.table.presses[possible]
            choice = ChosenPress(press, possible, decision.reason, decision.spikes, decision.probabilities)
        bits, took_s = (None, 0.0) if decision is None else (decision.information_bits, decision.chosen_in_s)
        engine.record(
            _event(step.index, choice, probabilities_as_text(candidates, choice.probabilities), bits, took_s)
        )
        return choice

    def _by_plan(self, step: ChoosePress, presses: Sequence[PossiblePress], candidates: int) -> ChosenPress:
        """Return the planned press, with the probabilities of the last count."""
        known = self._choices[-1].probabilities if self._choices else ()
        return ChosenPress(
            step.planned,
            None if step.planned is None else presses.index(step.planned),
            PLAN_DONE if step.planned is None else BY_PLAN,
            None,
            known or (1 / candidates,) * candidates,
        )

    def _opened(self, engine: Engine, choosing: "Choosing") -> "NextPressChooser":
        """Open the source of the counts, and record it. Raises CountError."""
        from rig.design.chooser import ChooserProcess, InProcessChooser
        from rig.design.counts_from.opened import virtual_name

        if engine.bench.virtual:
            if virtual_name(choosing.source) is None:
                raise CountError(
                    f"counts={choosing.source}: a dry-run has no nerve to record; use virtual:SA1 or virtual:MEASURE",
                    "not_virtual",
                )
            self._counter = InProcessChooser(choosing)
        else:
            self._counter = ChooserProcess(choosing, _waiting(engine, WallClock()))
        truth = self._counter.truth
        engine.record(
            CountSourceEvent(
                choosing.source, len(choosing.table.presses), None if truth is None else json.dumps(dict(truth))
            )
        )
        return self._counter

    @property
    def _late(self) -> str:
        if not self._choices:
            return f"no choice of the first press within {CHOICE_WITHIN_S:g} s"
        return f"no count of press index {len(self._choices) - 1} within {self._within_s:g} s"

    def _counted(self, engine: Engine, counter: "NextPressChooser", presses: int) -> "Decision | None":
        """Wait for the choice; None if the count does not arrive in time. Raises CountError."""
        clock = WallClock()
        last = self._choices[-1].possible if self._choices else None
        counter.begin(last)
        until_s = clock.monotonic_s() + (CHOICE_WITHIN_S if last is None else self._within_s)
        look = verbs.LooksAtClearance(engine, clock)
        while not counter.is_ready():
            began_s = clock.monotonic_s()
            verbs.safe_point(engine)
            now_s = clock.monotonic_s()
            until_s += now_s - began_s  # A pause of the operator does not count.
            if now_s >= until_s:
                return None
            look()
            clock.wait_s(LOOK_S)
        verbs.safe_point(engine)
        decision = counter.decision()
        if decision.possible is not None and not 0 <= decision.possible < presses:
            raise CountError(
                f"press {decision.possible} was chosen, which is none of the {presses} that were checked",
                "press_not_checked",
            )
        return decision


def _waiting(engine: Engine, clock: WallClock) -> Callable[[], None]:
    """Return what is done while the source opens: a pause takes effect, and the devices are looked at."""
    look = verbs.LooksAtClearance(engine, clock)

    def wait() -> None:
        verbs.safe_point(engine)
        look()

    return wait


def _designed(design: Any, blocks: Any, counts: str, hold_s: float, rest_s: float) -> "Designed":
    """Return the checked design of a script whose presses counts choose. Raises DesignError, ShapeError."""
    from rig.design.counts_from.opened import refuse_source
    from rig.design.designed import Designed

    refuse_source(counts)
    if not hold_s > 0:
        raise DesignError("hold_s=0: counts need a hold, more than 0 s", "no_hold")
    return Designed.of(design, blocks, hold_s=hold_s, rest_s=rest_s)


_KNOWN: WeakKeyDictionary[Finger, dict[tuple[Any, ...], "Choosing"]] = WeakKeyDictionary()


def _choosing(design: "Designed", config: Config, finger: Finger) -> "Choosing":
    """Return presses, responses and times of a design on a finger; the passes of a run compute them once."""
    from threadpoolctl import threadpool_limits

    from rig.design import design as designs
    from rig.design.chooser import Choosing

    known = _KNOWN.setdefault(finger, {})
    key = design.request, repr(design.plausible), config.model_dump_json()
    if key not in known:
        with threadpool_limits(1):
            table, times, _ = designs.bench_of(
                design.request, config, finger, design.plausible, lambda some, *_: iter(some), lambda *_: None
            )
        known[key] = Choosing(design.request, "", config, table, times)
    return known[key]


def _refuse_changed(index: int, choice: ChosenPress, presses: Sequence[PossiblePress]) -> None:
    """Raise BadInputError if the number of a recorded press now names another one, or none."""
    if choice.press is None or choice.possible is None:
        return
    if not 0 <= choice.possible < len(presses) or presses[choice.possible] != choice.press:
        raise BadInputError(
            f"choice {index} of the stopped run, {choice.press.title}, is no longer press {choice.possible} of "
            "those that may be chosen: the journal, the finger or this program changed; start a new run",
            "choice_changed",
        )


def _event(
    index: int, choice: ChosenPress, probabilities: str, bits: float | None = None, chosen_in_s: float = 0.0
) -> ChoiceEvent:
    press = choice.press
    return ChoiceEvent(
        index=index,
        indentor=None if press is None else press.shape,
        x_mm=None if press is None else press.x_mm,
        target=None if press is None else press.kind,
        value=None if press is None else press.target,
        reason=choice.reason,
        count=choice.count,
        probabilities=probabilities,
        information_bits=bits,
        possible=choice.possible,
        chosen_in_s=round(chosen_in_s, 6),
    )


def _recorded(event: Mapping[str, Any]) -> ChosenPress:
    """Return a choice of the journal."""
    possible = event.get("possible")
    press = (
        None if possible is None else PossiblePress(event["indentor"], event["x_mm"], event["target"], event["value"])
    )
    probabilities = tuple(probabilities_of(event).values())
    return ChosenPress(press, possible, event["reason"], event.get("count"), probabilities)
