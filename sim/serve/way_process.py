"""A finger that relaxes, in a process of its own: forces along a way, one step of time after another."""

import math
import time
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

from sim.config.fingertip_config import FingertipConfig
from sim.models.fingertip import Fingertip
from sim.models.relaxing.prony import PronyTerm
from sim.plant.plant import AS_MODELLED, Pose, Truth
from sim.plant.relaxing_plant import RelaxingPress
from sim.serve.press_process import FingerProcess, told, warmed


class Leg(NamedTuple):
    """A step of time, s, and where the indentor is at its end."""

    step_s: float
    pose: Pose


@dataclass(frozen=True)
class Way:
    """Legs since the last way: those that have been gone, and those that are planned after them."""

    gone: tuple[Leg, ...]
    planned: tuple[Leg, ...] = ()


@dataclass(frozen=True)
class WayAnswer:
    """The force at the end of each leg, gone and planned, N (NaN with a problem), and the time they took, s."""

    forces_n: tuple[float, ...]
    solve_s: float
    problem: str = ""


class WayProcess(FingerProcess[Way, WayAnswer]):
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

    def __call__(self, way: Way) -> WayAnswer:
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
