"""Finger in a separate process: contact takes tens of milliseconds, in which no byte may wait."""

import contextlib
import math
import multiprocessing
import signal
import sys
import time
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Generic, NamedTuple, TypeVar

from threadpoolctl import threadpool_limits

from sim.carriage import AS_MODELLED, Pose, Truth
from sim.config import FingertipConfig
from sim.contact.shapes import ShapeError
from sim.errors import ModelRangeError, SimError
from sim.models.relaxation import PronyTerm
from sim.workers import give_way, keep_freed_memory, leaving_ctrl_c_to_us

if TYPE_CHECKING:  # the process that serves the bytes never solves
    from sim.plant import PressedFinger, RelaxingPress

    if sys.platform == "win32":
        from multiprocessing.connection import PipeConnection as Connection
    else:
        from multiprocessing.connection import Connection

_READY_S = 300.0  # building a model takes some 15 s, minutes on a small machine
_WARM_MM = 0.1

Asked = TypeVar("Asked")
Answer = TypeVar("Answer")
Answering = Callable[[Asked], Answer]


@dataclass(frozen=True)
class PressAnswer:
    """Force at a pose (N, NaN with a problem) and the time it took (s)."""

    pose: Pose
    force_n: float
    solve_s: float
    problem: str = ""


class FingerNotLoadedError(SimError):
    """Error of a finger that did not load in its process, with a one-line message."""

    default_code = "not_loaded"


def _too_late() -> FingerNotLoadedError:
    return FingerNotLoadedError(
        f"virtual finger: not loaded within {_READY_S:g} s; start again on a less busy machine", "too_late"
    )


class ForceProcess(Generic[Asked, Answer]):
    """Process that answers requests one at a time, in order.

    It simulates an instrument that needs no processor time, so its priority is not lowered. Where Linux shares
    processors between sessions, it has its own session, so that other programs of the terminal do not delay it.
    """

    nice = 0
    """Its priority: 0 normal, 19 lowest."""

    def __init__(self, begin: Callable[[], Answering[Asked, Answer]]) -> None:
        """Start the process, load the finger by the importable `begin`, and wait. Raises FingerNotLoadedError."""
        context = multiprocessing.get_context("spawn")
        self._near, far = context.Pipe()
        self._process = context.Process(target=_serve, args=(far, begin, self.nice), daemon=True)
        with leaving_ctrl_c_to_us():
            self._process.start()
        far.close()
        try:
            problem = self._near.recv() if self._near.poll(_READY_S) else _too_late()
        except EOFError:
            problem = FingerNotLoadedError("virtual finger: its process ended while loading; start again", "ended")
        if problem is not None:
            self.close()
            raise problem

    @property
    def connection(self) -> "Connection[Asked, Answer]":
        """End of the pipe for requests and answers; another process may take it over."""
        return self._near

    def fileno(self) -> int:
        return self._near.fileno()

    def ask(self, request: Asked) -> None:
        self._near.send(request)

    def answer(self) -> Answer:
        """Wait for an answer. Raises EOFError if the process has ended."""
        found: Answer = self._near.recv()
        return found

    def close(self) -> None:
        self._near.close()
        self._process.join(5.0)
        self._process.terminate()


class PressProcess(ForceProcess[Pose, PressAnswer]):
    """Process that returns the elastic force at poses."""

    def __init__(self, config: FingertipConfig, indentor: str, truth: Truth = AS_MODELLED) -> None:
        """Load the finger and wait. Raises FingerNotLoadedError."""
        super().__init__(partial(_pressing, config, indentor, truth))


def message_of(error: Exception) -> str:
    """Return the message of a user error, else the error's type and message."""
    return str(error) if isinstance(error, (ModelRangeError, ShapeError)) else f"{type(error).__name__}: {error}"


def _serve(
    far: "Connection[FingerNotLoadedError | Answer | None, Asked]",
    begin: Callable[[], Answering[Asked, Answer]],
    nice: int,
) -> None:
    give_way(nice)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # where the parent did not block it: this process ends with its pipe
    keep_freed_memory()
    try:
        answer = begin()
    except Exception as error:
        far.send(FingerNotLoadedError(f"virtual finger: {message_of(error)}"))
        return
    threadpool_limits(1)  # on a busy machine, the threads of a small sum wait for each other
    far.send(None)
    with contextlib.suppress(EOFError, OSError):  # the pipe may close during a computation
        while True:
            far.send(answer(far.recv()))


def warmed(press: "PressedFinger") -> None:
    """Make an unused press, so that the first contact is not late; ignore a pose outside the model."""
    with contextlib.suppress(ModelRangeError):
        press.force_n(Pose(0.0, press.doi_mm(Pose(0.0, 0.0)) - _WARM_MM))


def _pressing(config: FingertipConfig, indentor: str, truth: Truth) -> Answering[Pose, PressAnswer]:
    from sim.models.fingertip import Fingertip
    from sim.plant import PressedFinger

    finger = Fingertip.load(config)
    warmed(PressedFinger(finger, indentor, truth))
    return partial(_answer, PressedFinger(finger, indentor, truth))


def _answer(press: "PressedFinger", pose: Pose) -> PressAnswer:
    began = time.perf_counter()
    try:
        force, problem = press.force_n(pose), ""
    except Exception as error:  # a press outside the model must not end this process
        force, problem = math.nan, message_of(error)
    return PressAnswer(pose, force, time.perf_counter() - began, problem)


# --- trajectory process ---
#
# Forces of a finger that relaxes depend on the trajectory, so its time steps are solved in order.


class Leg(NamedTuple):
    """Time step (s) and the indentor's pose at its end."""

    step_s: float
    pose: Pose


@dataclass(frozen=True)
class TrajectoryUpdate:
    """Legs since the last update: those completed, and those planned after them."""

    gone: tuple[Leg, ...]
    planned: tuple[Leg, ...] = ()


@dataclass(frozen=True)
class TrajectoryForces:
    """Force at the end of each leg, completed and planned (N, NaN with a problem), and the solve time (s)."""

    forces_n: tuple[float, ...]
    solve_s: float
    problem: str = ""


class TrajectoryProcess(ForceProcess[TrajectoryUpdate, TrajectoryForces]):
    """Process that returns forces along trajectories."""

    def __init__(
        self, config: FingertipConfig, indentor: str, terms: Sequence[PronyTerm], truth: Truth = AS_MODELLED
    ) -> None:
        """Load the finger and wait. Raises FingerNotLoadedError."""
        super().__init__(partial(_going, config, indentor, tuple(terms), truth))


class Going:
    """Trajectory solver that reuses predicted legs that came true; only completed legs enter the load history."""

    def __init__(self, press: "RelaxingPress") -> None:
        self._press = press
        self._predicted: list[tuple[Leg, float, RelaxingPress]] = []

    def __call__(self, update: TrajectoryUpdate) -> TrajectoryForces:
        """Return the forces of an update; legs without a solution do not enter the history."""
        began, self._problem = time.perf_counter(), ""
        gone = [self._next(leg) for leg in update.gone]
        here, predicted = self._press, self._predicted
        self._predicted = []
        for leg in update.planned:
            if predicted and predicted[0][0] == leg:
                self._predicted.append(predicted.pop(0))
            else:
                predicted = []
                last = self._predicted[-1][2] if self._predicted else here
                self._predicted.append((leg, *self._moved(last, leg)))
        forces = (*gone, *(force for _, force, _ in self._predicted))
        return TrajectoryForces(forces, time.perf_counter() - began, self._problem)

    def _next(self, leg: Leg) -> float:
        if self._predicted and self._predicted[0][0] == leg:
            _, force, self._press = self._predicted.pop(0)
            return force
        self._predicted = []
        force, self._press = self._moved(self._press, leg)
        return force

    def _moved(self, press: "RelaxingPress", leg: Leg) -> "tuple[float, RelaxingPress]":
        moved = copy(press)
        try:
            return moved.moved_to(leg.pose, leg.step_s), moved
        except Exception as error:  # a press outside the model must not end this process
            self._problem = message_of(error)
            return math.nan, press


def _going(config: FingertipConfig, indentor: str, terms: tuple[PronyTerm, ...], truth: Truth) -> Going:
    from sim.models.fingertip import Fingertip
    from sim.plant import RelaxingPress

    finger = Fingertip.load(config)
    warmed(RelaxingPress(finger, indentor, terms, truth))
    return Going(RelaxingPress(finger, indentor, terms, truth))
