"""What the rig is doing when a fault strikes: a run, a run that is resumed under force, and commands by hand.

Each scenario is the program's own: the session with its script, engine, journal and ending, or what the commands by
hand call. Each names its phases in `world.phase`; "" is not struck.
"""

from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Protocol, TypeVar, cast
from unittest.mock import patch

import rig.session.session as sessions
from rig.data import Run, RunFolder, read_run
from rig.devices.base import StageError
from rig.engine import Engine, Journal, Target
from rig.engine.motion import Direction, slices
from rig.engine.steps import MOST_MM
from rig.manual.session import ManualSession
from rig.plan.plan import Plan
from rig.protocol.api import ProtocolParameters, Rig
from rig.protocol.check import PressPlace, ScriptState
from rig.protocol.script import Script
from rig.protocol.steps import Step
from rig.records import Pace, PlannedIndentation, Prediction
from rig.session.early_ending import FinalPosition
from rig.session.execute import Live
from rig.session.resume import StoppedRun
from rig.session.session import NewRun, NoAttendant, Session
from studies.faults.campaign.world import VirtualWorld
from studies.faults.faulty_bench import PREDICTED, SOFT_TRIP_N, TARGET

E = TypeVar("E")
A = TypeVar("A")

INDENTOR = "bar:3.0"
_AREA_MM2 = 20.0
_MADE_FROM = ("protocol.py", "config.toml", "provenance.json")


@dataclass(frozen=True)
class Finished:
    """How a program ended: done, tripped, limited, aborted or failed; and what it reports of the indentor."""

    exit: str
    reason: str
    at: FinalPosition | None


class SpringModel:
    """The finger of springs as the finger model knows it."""

    def refuse_shape(self, indentor: str) -> None:
        """Any will do."""

    def press(self, indentor: str, x_mm: float, target: Target, pace: Pace | None = None) -> Prediction:
        """On the spring."""
        share = target.value / (PREDICTED.doi_mm if target.kind == "doi_mm" else 10.0)
        doi_mm = share if target.kind == "doi_mm" else share ** (1 / PREDICTED.exponent)
        force_gwt = 10.0 * doi_mm**PREDICTED.exponent
        contact_mm = PREDICTED.contact_mm
        return Prediction(indentor, x_mm, target, contact_mm, force_gwt, doi_mm, _AREA_MM2, 0.01)

    def touch_height_mm(self, indentor: str, x_mm: float, along_mm: float) -> float:
        """The same everywhere."""
        return PREDICTED.contact_mm


class Phased:
    """Carries steps out, and says what the rig is doing."""

    def __init__(self, world: VirtualWorld, phases: Mapping[str, str], engine: Engine, state: ScriptState) -> None:
        self._world, self._phases, self._count = world, phases, dict[str, int]()
        state.model = SpringModel()
        assert isinstance(engine._journal, Journal)
        world.journal = engine._journal
        self._live = Live(engine, state)

    def handle(self, step: Step[E, A], place: PressPlace) -> A:
        """What the engine found."""
        number = self._count[step.verb] = self._count.get(step.verb, 0) + 1
        self._world.verb = f"{step.verb} {number}"
        self._world.phase = self._phases.get(self._world.verb, "")
        return self._live.handle(step, place)


class PhasedByEvents(NoAttendant):
    """Names the phases within a press by what is journalled."""

    def __init__(
        self, world: VirtualWorld, phases: Mapping[tuple[str, str], str], act: Callable[[str], None]
    ) -> None:
        self._world, self._phases, self._act = world, phases, act

    def watch(self, stream: str, data: Mapping[str, Any]) -> None:
        """An event is in the journal."""
        self._world.phase = self._phases.get((self._world.verb, stream), self._world.phase)
        self._act(stream)


def _nothing(stream: str) -> None:
    """Nothing strikes the run itself."""


@dataclass(frozen=True)
class RunScenario:
    """A script that is run, and then taken up where it stopped before its end."""

    name: str
    script: Callable[[Rig], None]
    presses: int
    verbs: Mapping[str, str]  # phases by verb and its number
    events: Mapping[tuple[str, str], str]  # phases by verb and event
    stopped_first: bool = False  # whether the run that is struck is one that is resumed under force

    def play(self, world: VirtualWorld, folder: Path) -> Finished:
        """To its end, whatever happens to it on the way."""
        folder.mkdir(parents=True, exist_ok=True)
        for name in _MADE_FROM:
            (folder / name).touch()
        if not self.stopped_first:
            return self._session(world, folder, None, self.verbs)
        self._session(world, folder, None, {}, _stop_in_hold(world))
        return self._session(world, folder, read_run(folder), self.verbs, phase="resume")

    def take_up(self, world: VirtualWorld, folder: Path) -> Finished:
        """What is missing, by another program."""
        return self._session(world, folder, read_run(folder), {})

    def _session(
        self,
        world: VirtualWorld,
        folder: Path,
        before: Run | None,
        verbs: Mapping[str, str],
        act: Callable[[str], None] = _nothing,
        phase: str = "",
    ) -> Finished:
        into = _into(folder, self._as_script(), world, before)
        session = Session(
            self._as_script(),
            world.config,
            cast(Any, None),  # no step asks the finger: see Phased
            self._plan(),
            into,
            PhasedByEvents(world, self.events if verbs else {}, act),
        )
        world.phase = phase
        with patch.object(sessions, "Live", partial(Phased, world, verbs)):
            end = sessions._on_a_bench(session, RunFolder(folder), lambda log: world.connected(), None)
        world.phase = ""
        stop = read_run(world.folder or folder).stop
        status = "killed" if stop is None else str(stop["status"])
        return Finished(status, "" if end.problem is None else " ".join(str(end.problem).split()), end.at)

    def _as_script(self) -> Script:
        return Script(Path(__file__), self.name, self.name, "", ProtocolParameters(), self.script)

    def _plan(self) -> Plan:
        expected = vars(SpringModel().press(INDENTOR, 0.0, TARGET))
        planned = [PlannedIndentation(**expected, increments=1, hold_s=0.2) for _ in range(self.presses)]
        return Plan({"data": planned, "precondition": [], "reference": []}, first_soft_trip_n=SOFT_TRIP_N)


def _into(folder: Path, script: Script, world: VirtualWorld, before: Run | None) -> NewRun | StoppedRun:
    if before is None:
        return NewRun(folder)
    return StoppedRun(RunFolder(folder), script, world.config, True, before)


def _stop_in_hold(world: VirtualWorld) -> Callable[[str], None]:
    """The operator's stop in the first hold: the finger stays pressed."""

    def act(stream: str) -> None:
        if stream == "hold_start":
            raise StageError("stopped for the campaign")

    return act


def _press(rig: Rig) -> None:
    rig.mount(INDENTOR)
    rig.home()
    rig.zero()
    rig.move_to(x_mm=0.0)
    rig.indent(force_gwt=TARGET.value, hold_s=0.3)
    rig.move_to(x_mm=0.5)
    rig.indent(doi_mm=0.15, hold_s=0.1)


def _again(rig: Rig) -> None:
    rig.mount(INDENTOR)
    rig.home()
    rig.zero()
    rig.move_to(x_mm=0.0)
    rig.indent(doi_mm=0.2, hold_s=0.1)
    rig.indent(force_gwt=2.0, hold_s=0.1)
    rig.move_to(x_mm=1.0)
    rig.touch()


def _ramp(rig: Rig) -> None:
    rig.mount(INDENTOR)
    rig.home()
    rig.zero()
    rig.move_to(x_mm=0.0)
    rig.ramp(doi_mm=0.86, speed_mm_s=0.8, hold_s=0.1)
    rig.ramp(doi_mm=0.86, speed_mm_s=0.8, hold_s=0.1)


PRESS = RunScenario(
    "press",
    _press,
    2,
    {"home 1": "home", "zero 1": "zero", "move_to 1": "move", "move_to 2": "sideways"},
    {
        ("indent 1", "indentation_start"): "touch-off",
        ("indent 1", "touch"): "press",
        ("indent 1", "hold_start"): "hold",
        ("indent 1", "hold_end"): "lift",
        ("indent 1", "indentation_end"): "",
    },
)
AGAIN = RunScenario(
    "again",
    _again,
    2,
    {"touch 1": "find"},
    {
        ("indent 1", "indentation_start"): "identify",
        ("indent 1", "indentation_end"): "",
        ("indent 2", "indentation_start"): "return",
        ("indent 2", "touch"): "",
    },
)
RAMP = RunScenario(
    "ramp",
    _ramp,
    2,
    {"ramp 1": ""},
    {
        ("ramp 1", "ramp"): "ramp",
        ("ramp 1", "hold_start"): "",
        ("ramp 2", "ramp"): "second ramp",
        ("ramp 2", "hold_start"): "",
    },
)
"""At 0.8 mm/s to 8 gwt: the plan allows 0.806 mm/s. The second one begins without a press by increments."""
RESUME = RunScenario("resume", _press, 2, {}, {("", "home"): ""}, stopped_first=True)


class Scenario(Protocol):
    """Something that the rig does."""

    @property
    def name(self) -> str:
        """A word."""

    def play(self, world: VirtualWorld, folder: Path) -> Finished:
        """To its end, whatever happens to it on the way."""

    def take_up(self, world: VirtualWorld, folder: Path) -> Finished:
        """What a person does next, with a program of its own."""


_CONNECTS = ("jog down",)
"""Phases whose first words to the devices are struck, too: those of one jog are those of all."""


class HandScenario:
    """`rig home`, `rig zero` and `rig jog --axis`, each with drivers of its own, as the commands make them."""

    name = "hand"

    def play(self, world: VirtualWorld, folder: Path) -> Finished:
        """Home, zero, go over the finger, jog down to it and away, and home from contact."""
        self._home(world, "")
        self._zero(world)
        x_mm, height_mm = _far_mm(world)
        self._steps(world, "", Direction("x", -1), x_mm)
        self._steps(world, "", Direction("z", -1), height_mm - 0.5)
        self._steps(world, "jog down", Direction("z", -1), 1.5)
        self._steps(world, "jog down", Direction("z", -1), 0.2)
        self._steps(world, "jog up", Direction("z", 1), 2.5)
        self._steps(world, "jog sideways", Direction("x", -1), 1.0)
        self._steps(world, "", Direction("z", -1), 3.0)
        self._steps(world, "", Direction("z", -1), 0.2)
        self._home(world, "home by hand")
        return Finished("done", "", None)

    def take_up(self, world: VirtualWorld, folder: Path) -> Finished:
        """Home again."""
        self._home(world, "")
        return Finished("done", "", None)

    def _home(self, world: VirtualWorld, phase: str) -> None:
        world.phase = phase
        with closing(world.connected()) as bench:
            ManualSession(world.config, bench, bench.before).home()
        world.phase = ""

    def _zero(self, world: VirtualWorld) -> None:
        with closing(world.connected(moves=False)) as bench:
            session = ManualSession(world.config, bench, bench.before)
            with session.begun():
                session.zero()

    def _steps(self, world: VirtualWorld, phase: str, direction: Direction, by_mm: float) -> None:
        """Go so far, a command for each step, until one ends early."""
        for step_mm in slices(by_mm, MOST_MM):
            world.phase = phase if phase in _CONNECTS else ""
            with closing(world.connected(moves=False)) as bench:
                session = ManualSession(world.config, bench, bench.before)
                with session.begun():
                    world.phase = phase
                    found = session.step(direction, step_mm)
            world.phase = ""
            if found.ended_by is not None:
                return


def _far_mm(world: VirtualWorld) -> tuple[float, float]:
    """How far the indentor is from the pad's center and above its apex."""
    with closing(world.connected(moves=False)) as bench:
        at = bench.stage.look()
    frame = world.config.frame
    return at.x_mm - frame.pad_centre_x_mm, at.z_mm - frame.apex_z_mm


HAND = HandScenario()
SCENARIOS: tuple[Scenario, ...] = (PRESS, AGAIN, RAMP, RESUME, HAND)
