"""Plan a script: check every step against limits and the finger model before anything moves."""

import inspect
import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any, TypeVar

from rig.data import Run
from rig.data.folder import PLAN
from rig.engine.limits import CONTACT_EXPONENT, RampBound, pressure_limit_gwt
from rig.errors import BadInputError, RigError
from rig.plan.config import Config
from rig.plan.finger_model import FingerModel, Predictions, copy_name, named_file, with_stored_file
from rig.plan.sample_age import SampleAge
from rig.protocol.api import Handler, Rig
from rig.protocol.check import PressPlace, ScriptState
from rig.protocol.handlers import Patience, ResumeHandler, SilentScriptError, impatient
from rig.protocol.same_steps import SamePlan, planned_step, read_plan
from rig.protocol.script import Script, script_error
from rig.protocol.steps import Asked, ExpectedPresses, ExpectedTouch, Mount, Step
from rig.records import PlannedIndentation, Purpose
from rig.units import GWT_N
from rig_shared.user_files import read_bytes
from sim.contact.shapes import ShapeError, with_file_beside
from sim.errors import ModelRangeError
from sim.finger_process import Finger, FingerLostError

E = TypeVar("E")
A = TypeVar("A")

_SOFT_TRIP_OVER_PREDICTED = 2.0
SOFT_TRIP_OVER_BAND = 1.25
"""Soft trip over the band of an identified finger: allows only for noise and the bench."""

SMALLEST_SOFT_TRIP_N = 0.02
_REFUSALS = (RigError, ShapeError, ModelRangeError, SilentScriptError)


def _nothing_yet() -> dict[Purpose, list[PlannedIndentation]]:
    return {"data": [], "precondition": [], "reference": []}


@dataclass
class Plan:
    """Remaining presses of a protocol, by purpose, and touches, in order.

    `predictions` caches the model for the execution. `first_soft_trip_n` is the soft trip of a resumed run,
    `differences` its notes and rests that differ from the journal.
    """

    presses: dict[Purpose, list[PlannedIndentation]] = field(default_factory=_nothing_yet)
    touches: list[ExpectedTouch] = field(default_factory=list)
    predictions: Predictions = field(default_factory=dict)
    first_soft_trip_n: float | None = None
    differences: list[str] = field(default_factory=list)
    allowed: list[PlannedIndentation] = field(default_factory=list)  # presses that the script may choose instead
    steps: list[tuple[Step[Any, Any], Any]] = field(default_factory=list)  # with the predicted answers
    asked: list[Asked] = field(default_factory=list)  # what a run stores of its steps
    shape_files: dict[str, bytes] = field(default_factory=dict)  # content, by the names of their copies
    mounts: list[str] = field(default_factory=list)  # indentors to be mounted by hand, in order
    speeds_mm_s: list[tuple[float, PlannedIndentation]] = field(default_factory=list)  # speed of each press

    @property
    def indentations(self) -> list[PlannedIndentation]:
        """Presses that are data."""
        return self.presses["data"]

    @property
    def all_presses(self) -> list[PlannedIndentation]:
        """All presses, data or not, and those that the script may choose instead."""
        return [planned for presses in self.presses.values() for planned in presses] + self.allowed

    @property
    def all_speeds_mm_s(self) -> list[tuple[float, PlannedIndentation]]:
        """Speed of each press; a press that the script may choose is as fast as the fastest one of the plan."""
        fastest_mm_s = max((speed_mm_s for speed_mm_s, _ in self.speeds_mm_s), default=0.0)
        return [*self.speeds_mm_s, *((fastest_mm_s, press) for press in self.allowed)]

    @property
    def peak_force_gwt(self) -> float:
        """Highest predicted force (gwt); for an identified finger the upper end of its band."""
        return max((press.highest_gwt for press in self.all_presses), default=0.0)

    @property
    def soft_trip_n(self) -> float:
        """Soft trip (N): 2 × the predicted peak, or 1.25 × the upper end of a band, but above the noise."""
        if self.first_soft_trip_n is not None:
            return self.first_soft_trip_n
        banded = all(planned.band is not None for planned in self.all_presses)
        times = SOFT_TRIP_OVER_BAND if banded else _SOFT_TRIP_OVER_PREDICTED
        return max(times * self.peak_force_gwt * GWT_N, SMALLEST_SOFT_TRIP_N)


def make_plan(
    script: Script,
    config: Config,
    finger: Finger,
    before: Run | None = None,
    folder: Path | None = None,
    on_step: Callable[[int], None] = lambda steps: None,
    known: Predictions | None = None,
) -> Plan:
    """Plan a protocol. Raises BadInputError at the first step that cannot be done, FingerLostError.

    before: run to resume; finished steps are answered by its journal, not planned. folder: folder of that run, whose
    copies of shape files are used, and whose plan must be the same. on_step: called with the number of steps so far.
    known: predictions that are not solved again; further ones are added.
    """
    if inspect.iscoroutinefunction(script.run):
        raise BadInputError(
            f"protocol {script.path}: run(rig) is asynchronous; define it with `def`, not `async def`", "asynchronous"
        )
    first_soft_trip_n = None if before is None else before.start.get("soft_trip_n")
    plan = Plan(first_soft_trip_n=first_soft_trip_n, predictions={} if known is None else known)
    same = None if folder is None else read_plan(folder / PLAN)
    if before is not None and first_soft_trip_n is not None and (same is not None or not before.is_checked):
        whole = make_plan(script, config, finger, folder=folder, on_step=on_step, known=plan.predictions)
        plan.differences = whole.differences
        if not before.is_checked:
            _refuse_other_trip(before, whole.soft_trip_n)
        same = None
    where = partial(_kept, plan, script.path.parent) if folder is None else partial(with_stored_file, folder)
    state = ScriptState(config, FingerModel(finger, plan.predictions, where, config.identified))
    compared: list[SamePlan | ResumeHandler] = [] if same is None else [same]
    planner: Handler = Planner(state, plan, same)
    if before is not None and first_soft_trip_n is not None:
        planner = ResumeHandler(before, planner, config.habits.press_speed_mm_s)
        compared.append(planner)
    try:
        fresh = script.fresh()
        with impatient():
            fresh.run(Rig(fresh.parameters, state, Patience(planner, on_step)))
        for one in compared:
            one.end()
    except FingerLostError:
        raise
    except (Exception, SystemExit, SilentScriptError) as error:
        raise script_error(BadInputError, script.path, error, _REFUSALS) from None
    if not state.pressed["data"]:
        raise BadInputError(
            f"protocol {script.path}: run(rig) makes no indentation; call rig.indent() at least once",
            "indents_nowhere",
        )
    refuse_unseen(plan, config)
    refuse_fast_ramps(plan, config)
    plan.differences = list(dict.fromkeys(chain(plan.differences, *(one.differences for one in compared))))
    return plan


def _refuse_other_trip(before: Run, planned_n: float) -> None:
    """Refuse the soft trip in an unchecked journal if it does not follow from the plan."""
    recorded_n = before.start["soft_trip_n"]
    if not (isinstance(recorded_n, float | int) and math.isclose(recorded_n, planned_n, rel_tol=1e-6)):
        raise BadInputError(
            f"run folder {before.folder.path}: its journal, of an earlier version without checksums, gives a soft "
            f"trip of {recorded_n} N, but its protocol and configuration give {planned_n:.6g} N; start a new run",
            "other_soft_trip",
        )


def ramp_bound(plan: Plan, config: Config, ramp: PlannedIndentation) -> RampBound | None:
    """Return the bound of a planned ramp with the predicted stiffness; None for another press."""
    if ramp.ramp_mm_s is None:
        return None
    return RampBound.of(
        config, ramp.ramp_mm_s, _trip_gwt(plan, config, ramp), ramp.highest_gwt, ramp.predicted_doi_mm
    )


def _trip_gwt(plan: Plan, config: Config, press: PlannedIndentation) -> float:
    """Return the lowest trip of a planned press (gwt)."""
    area_gwt = pressure_limit_gwt(config.limits.max_pressure_kpa, press.contact_area_mm2)
    return min(config.limits.soft_trip_n / GWT_N, plan.soft_trip_n / GWT_N, area_gwt)


def refuse_fast_ramps(plan: Plan, config: Config) -> None:
    """Raise an error for a ramp whose stopping distance could pass the trip and the overshoot of a press."""
    for press in plan.all_presses:
        if bound := ramp_bound(plan, config, press):
            bound.refuse_too_fast(BadInputError, press.x_mm)


def refuse_unseen(plan: Plan, config: Config) -> None:
    """Raise an error for a press whose force could pass from its target to the plan's trip while a sample ages.

    A lower limits.soft_trip_n trips earlier, and is no reason to refuse.
    """
    press_age, trip_gwt = SampleAge.of(config), plan.soft_trip_n / GWT_N
    ramp_age = replace(press_age, increment_mm=math.inf)
    ramps = [(press.ramp_mm_s, press, ramp_age) for press in plan.all_presses if press.ramp_mm_s is not None]
    for speed_mm_s, press, age in [*((*one, press_age) for one in plan.all_speeds_mm_s), *ramps]:
        left_gwt = trip_gwt - press.highest_gwt
        stiffness_gwt_mm = CONTACT_EXPONENT * press.highest_gwt / press.predicted_doi_mm
        rise_gwt = age.rise_gwt(speed_mm_s, stiffness_gwt_mm)
        if rise_gwt > left_gwt:
            limit_mm_s = max(left_gwt, 0.0) / (stiffness_gwt_mm * age.age_s)
            raise BadInputError(
                f"a press at x = {press.x_mm:g} mm at {speed_mm_s:g} mm/s is too fast for the sensor: a sample is "
                f"up to {age.age_s:g} s old, in which the force rises by {rise_gwt:.2g} gwt, and the trip is "
                f"{left_gwt:.2g} gwt away; press at most at {limit_mm_s:.2g} mm/s",
                "too_fast_for_sensor",
            )


def _kept(plan: Plan, folder: Path, indentor: str) -> str:
    """Return the shape with its file beside the script, and store the content of the file for the run."""
    file = named_file(indentor)
    if file is None:
        return indentor
    found = with_file_beside(folder, indentor)
    path = Path(named_file(found) or file)
    if path.is_file():
        plan.shape_files[copy_name(file)] = read_bytes(path)
    return found


class Planner:
    """Handler that predicts each step with the model and adds its presses to the plan.

    same: plan of the run when it began, with which each step is compared.
    """

    def __init__(self, state: ScriptState, plan: Plan, same: SamePlan | None = None) -> None:
        self._state, self._plan, self._same = state, plan, same

    def handle(self, step: Step[E, A], place: PressPlace) -> A:
        """Return the predicted answer. Raises BadInputError for another step than that of the run's plan."""
        asked = planned_step(step, place, self._state.settings.habits.press_speed_mm_s)
        if asked is not None:
            self._plan.asked.append(asked)
            if self._same is not None:
                self._same.compare(asked)
        expected = step.expect(place, self._state)
        if isinstance(expected, ExpectedPresses):
            for press in expected.ids:
                self._plan.presses[press.purpose].append(expected.planned)
            ramps, speed_mm_s = expected.planned.ramp_mm_s is not None, self._state.settings.habits.press_speed_mm_s
            own_mm_s = None if ramps else getattr(step, "speed_mm_s", None)  # A ramp may begin with a press.
            self._plan.speeds_mm_s.append((own_mm_s or speed_mm_s, expected.planned))
        elif isinstance(expected, ExpectedTouch):
            self._plan.touches.append(expected)
        elif isinstance(step, Mount):
            self._plan.mounts.append(step.indentor)
        self._plan.allowed += step.allowed_presses(expected)
        answer = step.foreseen(expected)
        self._plan.steps.append((step, answer))
        return answer


_PREFIX: Mapping[str, str] = {"data": "", "precondition": "precondition_", "reference": "reference_"}


@dataclass(frozen=True)
class PredictedBand:
    """Predicted band of the uncontrolled quantity: force at a depth (gwt), depth at a force (mm)."""

    purpose: Purpose
    index: int
    key: str  # of hold_end
    low: float
    middle: float
    high: float


@dataclass(frozen=True)
class PredictionCheck:
    """Predicted band and the measurement in the last hold."""

    predicted: PredictedBand
    indentor: str
    x_mm: float
    measured: float

    @property
    def kept(self) -> bool:
        """Whether the measurement lies in the band."""
        return self.predicted.low <= self.measured <= self.predicted.high


def predicted_bands(plan: Plan) -> list[dict[str, Any]]:
    """Return the predicted bands for the run's first document; none without an identified finger or a fixed plan."""
    if plan.allowed:
        return []
    return [
        asdict(_predicted_band(purpose, index, press))
        for purpose, presses in plan.presses.items()
        for index, press in enumerate(presses)
        if press.band is not None
    ]


def _predicted_band(purpose: Purpose, index: int, press: PlannedIndentation) -> PredictedBand:
    assert press.band is not None
    if press.target.kind == "doi_mm":
        low, high = press.band.force_gwt
        return PredictedBand(purpose, index, "force_gwt", low, press.predicted_force_gwt, high)
    low, high = press.band.doi_mm
    return PredictedBand(purpose, index, "doi_mm", low, press.predicted_doi_mm, high)


def found(run: Run) -> list[PredictionCheck]:
    """Return the check of every finished press that has a predicted band."""
    pairs = []
    for promise in (PredictedBand(**one) for one in run.start.get("promised", [])):
        prefix = _PREFIX[promise.purpose]
        begun = [e for e in run.stream(f"{prefix}indentation_start") if e["index"] == promise.index]
        holds = [e for e in run.stream(f"{prefix}hold_end") if e["index"] == promise.index]
        if begun and len(holds) == begun[0]["increments"]:
            pairs.append(PredictionCheck(promise, begun[0]["indentor"], begun[0]["x_mm"], holds[-1][promise.key]))
    return pairs
