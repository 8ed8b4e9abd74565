"""The finger in a process of its own: contact takes tens of milliseconds, in which no byte must wait."""

import contextlib
import math
import multiprocessing
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from multiprocessing.connection import Connection
from typing import Generic, TypeVar

from threadpoolctl import threadpool_limits

from sim.config.fingertip_config import FingertipConfig
from sim.contact.shapes import ShapeError
from sim.errors import SimError
from sim.models.errors import ModelRangeError
from sim.models.fingertip import Fingertip
from sim.models.processes.workers import give_way, keep_freed_memory, leaving_ctrl_c_to_us
from sim.plant.plant import AS_MODELLED, Pose, Press, Truth

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
        "virtual finger: not loaded within {timeout_s:g} s", code="too_late", timeout_s=_READY_S
    )


class FingerProcess(Generic[Asked, Answer]):
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
            problem = FingerNotLoadedError("virtual finger: its process ended while it was loaded", code="ended")
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


class PressProcess(FingerProcess[Pose, PressAnswer]):
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


def warmed(press: Press) -> None:
    """Have what the first contact loads in memory, by one that nobody sees; where there is none, nothing."""
    with contextlib.suppress(ModelRangeError):
        press.force_n(Pose(0.0, press.doi_mm(Pose(0.0, 0.0)) - _WARM_MM))


def _pressing(config: FingertipConfig, indentor: str, truth: Truth) -> Answering[Pose, PressAnswer]:
    finger = Fingertip.load(config)
    warmed(Press(finger, indentor, truth))
    return partial(_answer, Press(finger, indentor, truth))


def _answer(press: Press, pose: Pose) -> PressAnswer:
    began = time.perf_counter()
    try:
        force, problem = press.force_n(pose), ""
    except Exception as error:  # a scene beyond the model must not end this process
        force, problem = math.nan, told(error)
    return PressAnswer(pose, force, time.perf_counter() - began, problem)
