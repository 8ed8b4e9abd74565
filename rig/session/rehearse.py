"""Rehearsal of a protocol on springs, which predicts its duration before a motion.

The engine, the drivers, the bytes and the clock are those of a dry-run. Only the finger is replaced, by one spring
for each press, fitted to two solutions of the finger model, which costs almost no time.
"""

import io
import math
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

from rig.bench.sync_line import sync_line
from rig.bench.virtual import bench_around, with_stand_ins
from rig.data import Run
from rig.data.run_state import Course, Timeline
from rig.engine import Engine, Target, verbs
from rig.engine.limits import CONTACT_EXPONENT, FingerStiffness
from rig.plan.config import Config, VirtualSettings
from rig.plan.finger_model import FingerModel, with_stored_file
from rig.plan.plan import Plan
from rig.protocol.api import Handler, Rig
from rig.protocol.check import Model, NoPredictionError, PressPlace, ScriptState
from rig.protocol.handlers import Patience, ResumeHandler
from rig.protocol.script import Script
from rig.protocol.steps import ExpectedPresses, ExpectedTouch, Step
from rig.records import Prediction
from rig.session.execute import execute
from rig.session.script_run import run_script
from rig.units import GWT_N
from sim.carriage import Carriage, TruePose
from sim.contact.shapes import with_file_beside
from sim.devices.clock import VirtualClock
from sim.finger_process import Finger

E = TypeVar("E")
A = TypeVar("A")


@dataclass(frozen=True)
class Spring:
    """Spring of one press: force_n · (DOI / doi_mm)^exponent."""

    contact_mm: float
    doi_mm: float
    force_n: float
    exponent: float

    @classmethod
    def fitted(cls, planned: Prediction, model: Model) -> "Spring":
        """Fit the model's force at the target and at half its depth; without that, use the exponent of Hertz."""
        doi_mm, force_gwt = planned.predicted_doi_mm, planned.predicted_force_gwt
        try:
            half = model.press(planned.indentor, planned.x_mm, Target("doi_mm", 0.5 * doi_mm)).predicted_force_gwt
        except NoPredictionError:
            half = 0.0
        exponent = math.log2(force_gwt / half) if half > 0 else CONTACT_EXPONENT
        return cls(planned.expected_contact_mm, doi_mm, force_gwt * GWT_N, exponent)

    def force_at(self, height_mm: float) -> float:
        """Return the force (N) with the indentor's lowest point at this height above the nominal apex."""
        return float(self.force_n * (max(self.contact_mm - height_mm, 0.0) / self.doi_mm) ** self.exponent)


class SpringPlant:
    """Carriage over at most one spring in place of the finger."""

    def __init__(self, carriage: Carriage) -> None:
        self._carriage = carriage
        self.spring: Spring | None = None

    def mount(self, indentor: str) -> None:
        """Do nothing: a spring is fitted to its indentor."""

    def pose_at(self, t_s: float) -> TruePose:
        """Return the true x and DOI (mm)."""
        pose = self._carriage.pose_at(t_s)
        contact_mm = -math.inf if self.spring is None else self.spring.contact_mm
        return TruePose(pose.x_mm, pose.above_apex_mm, contact_mm - pose.above_apex_mm)

    def force_n(self, t_s: float) -> float:
        """Return the force (N) at an instant."""
        return 0.0 if self.spring is None else self.spring.force_at(self._carriage.pose_at(t_s).above_apex_mm)


# Roughly a finger under a sphere: a touch ends before the stiffness matters.
_UNDER_A_TOUCH = {"doi_mm": 1.0, "force_n": 0.1, "exponent": 1.5}


class Rehearsing:
    """Handler that sets the spring under the indentor and carries out each step."""

    def __init__(self, engine: Engine, state: ScriptState, plant: SpringPlant) -> None:
        self._engine, self._state, self._plant = engine, state, plant

    def handle(self, step: Step[E, A], place: PressPlace) -> A:
        """Carry out the step on springs and return its result."""
        expected = step.expect(place, self._state)
        if isinstance(expected, ExpectedPresses):
            self._plant.spring = Spring.fitted(expected.planned, self._state.model)
        elif isinstance(expected, ExpectedTouch):
            self._plant.spring = Spring(expected.contact_mm, **_UNDER_A_TOUCH)
        return execute(self._engine, step, expected, rehearsal=True)


@dataclass(frozen=True)
class Rehearsed:
    """Predicted course of a run, its contact time (s), and number of events in its journal."""

    course: Course
    contact_s: float
    events: int

    @property
    def duration_s(self) -> float:
        """Predicted duration (s)."""
        return self.course.duration_s


def rehearsed(script: Script, config: Config, finger: Finger, plan: Plan, before: Run | None = None) -> Rehearsed:
    """Rehearse a script, or what remains of a stopped run, on springs; `plan` lends its predictions.

    Raises EngineError if the script would not reach its end.
    """
    settings = with_stand_ins(config.model_copy(update={"virtual": VirtualSettings()}))
    clock = VirtualClock()
    plants: list[SpringPlant] = []

    def make_plant(carriage: Carriage) -> SpringPlant:
        plants.append(SpringPlant(carriage))
        return plants[0]

    bench = bench_around(make_plant, settings, clock, io.StringIO())
    timeline = Timeline(clock.monotonic_s)
    stiffness = FingerStiffness.of(plan.all_presses)
    with sync_line(settings.sync, bench) as line:
        engine = Engine(settings, bench, timeline, plan.soft_trip_n, stiffness=stiffness, sync_line=line)
    where = (
        partial(with_file_beside, script.path.parent)
        if before is None
        else partial(with_stored_file, before.folder.path)
    )
    state = ScriptState(settings, FingerModel(finger, plan.predictions, where, config.identified))
    handler: Handler = Rehearsing(engine, state, plants[0])
    if before is not None:
        verbs.home(engine)
        handler = ResumeHandler(before, handler, settings.habits.press_speed_mm_s)
    script = script.fresh()
    run_script(script, engine, Rig(script.parameters, state, Patience(handler)))
    course = Course(clock.monotonic_s(), timeline.instants_s, timeline.words, timeline.marks)
    return Rehearsed(course, engine.contact_time.total_s, timeline.events)
