"""The finger in a process of its own: contact takes tens of milliseconds, in which no byte must wait."""

import contextlib
import math
import multiprocessing
import signal
import time
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass
from functools import partial
from multiprocessing.connection import Connection
from typing import Generic, NamedTuple, TypeVar

from threadpoolctl import threadpool_limits

from sim.config import FingertipConfig
from sim.contact.shapes import ShapeError
from sim.errors import ModelRangeError, SimError
from sim.models.fingertip import Fingertip
from sim.models.relaxation import PronyTerm
from sim.plant import AS_MODELLED, Pose, PressedFinger, RelaxingPress, Truth
from sim.workers import give_way, keep_freed_memory, leaving_ctrl_c_to_us

_READY_S = 300.0  # building a model takes some 15 s, minutes on a small machine
_WARM_MM = 0.1

Asked = TypeVar("Asked")
Answer = TypeVar("Answer")
Answering = Callable[[Asked], Answer]


@dataclass(frozen=True)
class PressAnswer:
    """The force at a pose, N (NaN with a problem), and the time it took, s."""

    pose: Pose
    force_n: float
    solve_s: float
    problem: str = ""


class FingerNotLoadedError(SimError):
    """The process of the finger has no finger; the message is one line."""

    default_code = "not_loaded"


def _too_late() -> FingerNotLoadedError:
    return FingerNotLoadedError(
        "virtual finger: not loaded within {timeout_s:g} s; start again on a less busy machine",
        code="too_late",
        timeout_s=_READY_S,
    )


class ForceProcess(Generic[Asked, Answer]):
    """Answers what it is asked, one at a time, in the order it is sent.

    It stands for something that needs no processor: it gives way to nobody, and where Linux shares processors between
    sessions it has a session of its own, so that what else was begun in a terminal does not keep it waiting.
    """

    def __init__(self, begin: Callable[[], Answering[Asked, Answer]]) -> None:
        """`begin`, importable, loads the finger there, and then this returns. Raises FingerNotLoadedError."""
        context = multiprocessing.get_context("spawn")
        self._near, far = context.Pipe()
        self._process = context.Process(target=_serve, args=(far, begin), daemon=True)
        with leaving_ctrl_c_to_us():
            self._process.start()
        far.close()
        try:
            problem = self._near.recv() if self._near.poll(_READY_S) else _too_late()
        except EOFError:
            problem = FingerNotLoadedError(
                "virtual finger: its process ended while loading; start again", code="ended"
            )
        if problem is not None:
            self.close()
            raise problem

    def fileno(self) -> int:
        return self._near.fileno()

    def ask(self, asked: Asked) -> None:
        self._near.send(asked)

    def answer(self) -> Answer:
        """Waits for it. Raises EOFError if the process has gone."""
        found: Answer = self._near.recv()
        return found

    def close(self) -> None:
        self._near.close()
        self._process.join(5.0)
        self._process.terminate()


class PressProcess(ForceProcess[Pose, PressAnswer]):
    """The elastic force at one pose after another."""

    def __init__(self, config: FingertipConfig, indentor: str, truth: Truth = AS_MODELLED) -> None:
        """Returns when the finger is loaded. Raises FingerNotLoadedError where it cannot be."""
        super().__init__(partial(_pressing, config, indentor, truth))


def told(error: Exception) -> str:
    """In words where they were made for people, else with what kind of error it is."""
    return str(error) if isinstance(error, (ModelRangeError, ShapeError)) else f"{type(error).__name__}: {error}"


def _serve(
    far: "Connection[FingerNotLoadedError | Answer | None, Asked]", begin: Callable[[], Answering[Asked, Answer]]
) -> None:
    give_way(0)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # where it was not held back: this process ends with its pipe
    keep_freed_memory()
    try:
        answer = begin()
    except Exception as error:
        problem = error.code if isinstance(error, SimError) else type(error).__name__
        far.send(FingerNotLoadedError("virtual finger: {problem}", problem=told(error), problem_code=problem))
        return
    threadpool_limits(1)  # beside other work two threads of a small sum wait for each other's turn at a processor
    far.send(None)
    with contextlib.suppress(EOFError, OSError):  # the pipe is closed, perhaps while an answer is being made
        while True:
            far.send(answer(far.recv()))


def warmed(press: PressedFinger) -> None:
    """Have what the first contact loads in memory, by one that nobody sees; where there is none, nothing."""
    with contextlib.suppress(ModelRangeError):
        press.force_n(Pose(0.0, press.doi_mm(Pose(0.0, 0.0)) - _WARM_MM))


def _pressing(config: FingertipConfig, indentor: str, truth: Truth) -> Answering[Pose, PressAnswer]:
    finger = Fingertip.load(config)
    warmed(PressedFinger(finger, indentor, truth))
    return partial(_answer, PressedFinger(finger, indentor, truth))


def _answer(press: PressedFinger, pose: Pose) -> PressAnswer:
    began = time.perf_counter()
    try:
        force, problem = press.force_n(pose), ""
    except Exception as error:  # a scene beyond the model must not end this process
        force, problem = math.nan, told(error)
    return PressAnswer(pose, force, time.perf_counter() - began, problem)


# --- way process ---
#
# A finger that relaxes, in a process of its own: forces along a way, one step of time after another.


class Leg(NamedTuple):
    """A step of time, s, and where the indentor is at its end."""

    step_s: float
    pose: Pose


@dataclass(frozen=True)
class TrajectoryUpdate:
    """Legs since the last way: those that have been gone, and those that are planned after them."""

    gone: tuple[Leg, ...]
    planned: tuple[Leg, ...] = ()


@dataclass(frozen=True)
class WayAnswer:
    """The force at the end of each leg, gone and planned, N (NaN with a problem), and the time they took, s."""

    forces_n: tuple[float, ...]
    solve_s: float
    problem: str = ""


class WayProcess(ForceProcess[TrajectoryUpdate, WayAnswer]):
    """Forces along one way after another."""

    def __init__(
        self, config: FingertipConfig, indentor: str, terms: Sequence[PronyTerm], truth: Truth = AS_MODELLED
    ) -> None:
        """Returns when the finger is loaded. Raises FingerNotLoadedError where it cannot be."""
        super().__init__(partial(_going, config, indentor, tuple(terms), truth))


class Going:
    """What was foreseen is taken where it came so; the tissue remembers what was gone, not what was planned."""

    def __init__(self, press: RelaxingPress) -> None:
        self._press = press
        self._foreseen: list[tuple[Leg, float, RelaxingPress]] = []

    def __call__(self, way: TrajectoryUpdate) -> WayAnswer:
        """Its forces; what has no answer is not remembered."""
        began, self._problem = time.perf_counter(), ""
        gone = [self._next(leg) for leg in way.gone]
        here, foreseen = self._press, self._foreseen
        self._foreseen = []
        for leg in way.planned:
            if foreseen and foreseen[0][0] == leg:
                self._foreseen.append(foreseen.pop(0))
            else:
                foreseen = []
                last = self._foreseen[-1][2] if self._foreseen else here
                self._foreseen.append((leg, *self._moved(last, leg)))
        forces = (*gone, *(force for _, force, _ in self._foreseen))
        return WayAnswer(forces, time.perf_counter() - began, self._problem)

    def _next(self, leg: Leg) -> float:
        if self._foreseen and self._foreseen[0][0] == leg:
            _, force, self._press = self._foreseen.pop(0)
            return force
        self._foreseen = []
        force, self._press = self._moved(self._press, leg)
        return force

    def _moved(self, press: RelaxingPress, leg: Leg) -> tuple[float, RelaxingPress]:
        onward = copy(press)
        try:
            return onward.moved_to(leg.pose, leg.step_s), onward
        except Exception as error:  # a scene beyond the model must not end this process
            self._problem = told(error)
            return math.nan, press


def _going(config: FingertipConfig, indentor: str, terms: tuple[PronyTerm, ...], truth: Truth) -> Going:
    finger = Fingertip.load(config)
    warmed(RelaxingPress(finger, indentor, terms, truth))
    return Going(RelaxingPress(finger, indentor, terms, truth))
