"""Plan a script: check every step against limits and the finger model before anything moves."""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from rig.data import Run
from rig.errors import BadInputError
from rig.plan.config import Config
from rig.plan.finger_model import FingerModel, Predictions, copy_name, kept_in, named_file
from rig.protocol.api import Handler, Rig
from rig.protocol.check import Spot, Walk
from rig.protocol.handlers import Patience, SilentScriptError, TakenUp, impatient
from rig.protocol.script import Script, said_of_script
from rig.protocol.steps import ExpectedPresses, ExpectedTouch, Step
from rig.records import PlannedIndentation, Purpose
from rig.units import GWT_N
from sim.contact.shapes import ShapeError
from sim.errors import ModelRangeError
from sim.finger_process import Finger, FingerLostError

E = TypeVar("E")
A = TypeVar("A")

_SOFT_TRIP_OVER_PREDICTED = 2.0
SOFT_TRIP_OVER_BAND = 1.25
"""Of a finger that was met, or is being met: besides its band only noise and the bench are to be allowed for."""

SMALLEST_SOFT_TRIP_N = 0.02
_REFUSALS = (BadInputError, ShapeError, ModelRangeError, SilentScriptError)


def _nothing_yet() -> dict[Purpose, list[PlannedIndentation]]:
    return {"data": [], "precondition": [], "reference": []}


@dataclass
class Plan:
    """Every press that a script has still to make, by its purpose, and every touch, in the script's order.

    `predictions` are what the model has been asked; whoever carries the plan out looks there first.
    `first_soft_trip_n` is the soft trip of the run that the plan takes up.
    """

    presses: dict[Purpose, list[PlannedIndentation]] = field(default_factory=_nothing_yet)
    touches: list[ExpectedTouch] = field(default_factory=list)
    predictions: Predictions = field(default_factory=dict)
    first_soft_trip_n: float | None = None
    shape_files: dict[str, bytes] = field(default_factory=dict)  # as they were read, by the names of their copies

    @property
    def indentations(self) -> list[PlannedIndentation]:
        """Those that are data."""
        return self.presses["data"]

    @property
    def all_presses(self) -> list[PlannedIndentation]:
        """Data and what is none."""
        return [planned for presses in self.presses.values() for planned in presses]

    @property
    def peak_force_gwt(self) -> float:
        """Highest force the model predicts; of a finger that was met the upper end of its band."""
        return max((planned.highest_gwt for planned in self.all_presses), default=0.0)

    @property
    def soft_trip_n(self) -> float:
        """Twice the highest force predicted, or a quarter above a band's; never so little that noise would trip."""
        if self.first_soft_trip_n is not None:
            return self.first_soft_trip_n
        met = all(planned.band is not None for planned in self.all_presses)
        times = SOFT_TRIP_OVER_BAND if met else _SOFT_TRIP_OVER_PREDICTED
        return max(times * self.peak_force_gwt * GWT_N, SMALLEST_SOFT_TRIP_N)


def make_plan(
    script: Script,
    config: Config,
    finger: Finger,
    before: Run | None = None,
    folder: Path | None = None,
    told: Callable[[int], None] = lambda steps: None,
) -> Plan:
    """Walk through the script; raises BadInputError at the first step that cannot be done, FingerLostError.

    `before` is the run that is to be taken up: what it has done is answered by its journal, and not planned, where
    that tells the soft trip of the whole; `folder` is that run's, whose copies of files that shapes name are read.
    `told` hears how many steps there are so far.
    """
    if inspect.iscoroutinefunction(script.run):
        raise BadInputError(
            "protocol {path}: run(rig) is asynchronous; define it with `def`, not `async def`",
            code="asynchronous",
            path=str(script.path),
        )
    first_soft_trip_n = None if before is None else before.start.get("soft_trip_n")
    plan = Plan(first_soft_trip_n=first_soft_trip_n)
    where = partial(_kept, plan) if folder is None else partial(kept_in, folder)
    walk = Walk(config, FingerModel(finger, plan.predictions, where, config.met))
    planner: Handler = Planner(walk, plan)
    if before is not None and first_soft_trip_n is not None:
        planner = TakenUp(before, planner)
    try:
        with impatient():
            script.run(Rig(script.parameters, walk, Patience(planner, told)))
    except FingerLostError:
        raise
    except (Exception, SystemExit, SilentScriptError) as error:
        raise said_of_script(BadInputError, script.path, error, _REFUSALS) from None
    if not walk.pressed["data"]:
        raise BadInputError(
            "protocol {path}: run(rig) makes no indentation; call rig.indent() at least once",
            code="indents_nowhere",
            path=str(script.path),
        )
    return plan


def _kept(plan: Plan, indentor: str) -> str:
    """The name as it is; what a file that it names holds now is what the run will have."""
    file = named_file(indentor)
    if file is not None and Path(file).is_file():
        plan.shape_files[copy_name(file)] = Path(file).read_bytes()
    return indentor


class Planner:
    """Carries out nothing: each step is foreseen by the model, and its presses go into the plan."""

    def __init__(self, walk: Walk, plan: Plan) -> None:
        self._walk, self._plan = walk, plan

    def handle(self, step: Step[E, A], spot: Spot) -> A:
        """The answer that the model foresees."""
        expected = step.expect(spot, self._walk)
        if isinstance(expected, ExpectedPresses):
            for press in expected.ids:
                self._plan.presses[press.purpose].append(expected.planned)
        elif isinstance(expected, ExpectedTouch):
            self._plan.touches.append(expected)
        return step.foreseen(expected)


_PREFIX: Mapping[str, str] = {"data": "", "precondition": "precondition_", "reference": "reference_"}


@dataclass(frozen=True)
class Promise:
    """The band of what a press does not control: the force at a depth (gwt), the depth at a force (mm)."""

    purpose: Purpose
    index: int
    key: str  # of hold_end
    low: float
    middle: float
    high: float


@dataclass(frozen=True)
class PredictionCheck:
    """A promise beside what was measured in the last hold."""

    promise: Promise
    indentor: str
    x_mm: float
    measured: float

    @property
    def kept(self) -> bool:
        """Whether it lies in the band."""
        return self.promise.low <= self.measured <= self.promise.high


def promised(plan: Plan) -> list[dict[str, Any]]:
    """As the run's first document says it; nothing of a finger that nobody met."""
    return [
        asdict(_promise(purpose, index, press))
        for purpose, presses in plan.presses.items()
        for index, press in enumerate(presses)
        if press.band is not None
    ]


def _promise(purpose: Purpose, index: int, press: PlannedIndentation) -> Promise:
    assert press.band is not None
    if press.target.kind == "doi_mm":
        low, high = press.band.force_gwt
        return Promise(purpose, index, "force_gwt", low, press.predicted_force_gwt, high)
    low, high = press.band.doi_mm
    return Promise(purpose, index, "doi_mm", low, press.predicted_doi_mm, high)


def found(run: Run) -> list[PredictionCheck]:
    """Of every press that was promised and finished."""
    pairs = []
    for promise in (Promise(**one) for one in run.start.get("promised", [])):
        prefix = _PREFIX[promise.purpose]
        begun = [e for e in run.stream(f"{prefix}indentation_start") if e["index"] == promise.index]
        holds = [e for e in run.stream(f"{prefix}hold_end") if e["index"] == promise.index]
        if begun and len(holds) == begun[0]["increments"]:
            pairs.append(PredictionCheck(promise, begun[0]["indentor"], begun[0]["x_mm"], holds[-1][promise.key]))
    return pairs
