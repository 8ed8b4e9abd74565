"""The course of a meeting: which press comes next, what it said, and when it is enough. Moves nothing."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from rig.plan.config import Config
from rig.plan.plan import SMALLEST_SOFT_TRIP_N, SOFT_TRIP_OVER_BAND
from rig.records import BETWEEN_INCREMENTS_S
from rig.settings import RigSettings
from rig.units import GWT_N
from sim.errors import ModelRangeError
from sim.identification.next_press import Chooser, PressAt, SkinSearch, highest_gwt
from sim.identification.posterior import PRESS_ERROR, SHAPE_ERROR, Surprise, learn, no_finger, nothing_learned
from sim.identification.predicted_forces import Foreseen, Given, RampAndHold
from sim.identification.prior import named
from sim.identification.uncertainty_bands import Width, band, standard_deviations

SHAPES = ("sphere:4", "flat:3", "bar:3.0")
PLACES_MM = (-1.2, 0.0, 1.2)
DEPTHS_MM = (0.2, 0.3, 0.45, 0.6, 0.8, 1.0)
BEYOND_DEPTH = 1.1
"""How much deeper than a press its force is foreseen: it may find the skin higher than it lies."""

_GENTLE = (0.25, 0.5)  # of the highest force, in the first presses
_TRIP_SHARE = 0.995  # of the likely fingers press below what trips, by a margin more
_LEAST_NARROWER = 0.9  # of the width before the first press: else nothing was learned of it
_NOT_LEARNED_SHARE = 0.8  # of a parameter's sd before
_LEAST_PRESSES = 4  # fewer tell neither whether it is a finger nor that it is none
_LEAST_GWT, _EXPONENT = 1e-3, 1.7
_MODEL = float(np.hypot(PRESS_ERROR, SHAPE_ERROR))

TOUCH_SD_MM = 0.015
"""How well a touch finds the skin, by a cell with 0.02 gwt of noise."""

FELT_GWT = 0.1
"""What counts as a touch: five times the noise of a cell, since where the skin lies is fitted afterwards."""

MODEL_ERROR, USUAL_MISFIT = 0.018, 0.8
"""Relative sd of a force on a shape that was not pressed, beside the spread of the likely fingers, and how far
off the likeliest usually is: squared standardised distance over the number of readings (docs/identification.md)."""


@dataclass(frozen=True)
class IdentificationOptions:
    """When a meeting has learned enough, and how gently."""

    goals: tuple[PressAt, ...]
    width: float = 0.08
    presses: int = 8
    most_gwt: float = 20.0
    shapes: tuple[str, ...] = SHAPES
    hold_s: float = 1.5

    @property
    def indentors(self) -> tuple[str, ...]:
        """All shapes that are pressed or asked for, each once."""
        return tuple(dict.fromkeys([*self.shapes, *(goal.indentor for goal in self.goals)]))


def felt_surely(config: Config) -> Config:
    """The configuration with a touch that noise does not make."""
    felt = max(config.habits.touch_force_gwt, FELT_GWT)
    return config.model_copy(update={"habits": config.habits.model_copy(update={"touch_force_gwt": felt})})


@dataclass(frozen=True)
class PressReport:
    """One press, for whoever looks on."""

    number: int
    press: PressAt
    surprise: Surprise
    trip_gwt: float  # that held for it
    widest: float  # half-width of the least known goal, from now on


@dataclass
class Meeting:
    """What was learned so far. Raises ModelRangeError where a shape cannot be foreseen."""

    settings: RigSettings
    foreseen: Foreseen
    wanted: IdentificationOptions
    seed: int = 0
    given: list[Given] = field(default_factory=list)
    told: list[PressReport] = field(default_factory=list)

    def __post_init__(self) -> None:
        habits = self.settings.habits
        pace = RampAndHold(habits.increment_mm, habits.increment_mm / habits.press_speed_mm_s + BETWEEN_INCREMENTS_S)
        self._menu = [PressAt(s, x, d) for s in self.wanted.shapes for x in PLACES_MM for d in self._depths_mm(s)]
        search = SkinSearch(self.settings.limits.search_mm - habits.increment_mm, habits.touch_force_gwt)
        self.chooser = Chooser(self.foreseen, self.wanted.goals, pace, search)
        for goal in self.wanted.goals:
            if goal.doi_mm > self._deepest_mm(goal.indentor):
                raise ModelRangeError(
                    "{indentor} to {doi_mm:.2f} mm: the model predicts its force only to {deepest_mm:.2f} "
                    "mm; choose a smaller depth or a wider patch of the mesh",
                    code="goal_too_deep",
                    indentor=goal.indentor,
                    doi_mm=goal.doi_mm,
                    deepest_mm=self._deepest_mm(goal.indentor),
                )
        self._chance = np.random.default_rng(self.seed)
        self.learned = self.before = nothing_learned(self.foreseen.prior, self._chance)
        self.widths_before = self.widths

    def _depths_mm(self, shape: str) -> Sequence[float]:
        deepest_mm = min(self.settings.limits.max_doi_mm, self._deepest_mm(shape) / BEYOND_DEPTH)
        return [d for d in DEPTHS_MM if d <= deepest_mm + 1e-9]

    def _deepest_mm(self, shape: str) -> float:
        return self.foreseen.table(shape).scope.depth_mm[1]

    @property
    def widths(self) -> list[Width]:
        """How well the force of each goal is known."""
        return self.chooser.goal_widths(self.learned, self.own_error)

    @property
    def own_error(self) -> float:
        """Relative sd of a force beside the spread: by so much more as readings are farther off (Birge's ratio)."""
        readings = max(int(self.learned.readings.sum()), 1)
        return MODEL_ERROR * math.sqrt(max(self.learned.total / (USUAL_MISFIT * readings), 1.0))

    @property
    def widest(self) -> float:
        """Half-width of the least known goal."""
        return max(width.half for width in self.widths)

    @property
    def enough(self) -> bool:
        """Whether there is nothing more to press."""
        if len(self.told) < min(_LEAST_PRESSES, self.wanted.presses):
            return False
        known = self.told[-1].widest <= self.wanted.width
        return known or len(self.told) >= self.wanted.presses or self.stranger is not None

    @property
    def stranger(self) -> str | None:
        """Why this is no finger of the prior; None where it may be one."""
        return no_finger(self.foreseen, self.given, self.learned, [told.surprise for told in self.told])

    def next(self) -> PressAt:
        """The press that tells most, gentle first, and each shape once before any comes again."""
        share = _GENTLE[len(self.told)] if len(self.told) < len(_GENTLE) else 1.0
        known = {told.press.indentor for told in self.told}
        new = [press for press in self._menu if press.indentor not in known] or self._menu
        return self.chooser.choose(self.learned, share * self.wanted.most_gwt, new)

    def trip_n(self, press: PressAt) -> float:
        """From the upper band of what is known now."""
        highest = highest_gwt(self.foreseen, self.learned.draws, press, self.chooser.pace, _TRIP_SHARE)
        return max(SOFT_TRIP_OVER_BAND * highest * GWT_N, SMALLEST_SOFT_TRIP_N)

    def take(self, press: PressAt, given: Given) -> PressReport:
        """Learn from a press."""
        surprise, trip_gwt = self._surprise(given), self.trip_n(press) / GWT_N
        self.given.append(given)
        self.learned = learn(self.foreseen, self.given, self.learned, self._chance)
        self.told.append(PressReport(len(self.told) + 1, press, surprise, trip_gwt, self.widest))
        return self.told[-1]

    def _surprise(self, given: Given) -> Surprise:
        peak = int(np.argmax(given.force_gwt))
        measured = max(float(given.force_gwt[peak]), _LEAST_GWT)
        way = given.by_depth
        forces = self.foreseen.forces_gwt(self.learned.draws, way)[:, peak]
        depth_mm = max(-float(way.height_mm.min()), TOUCH_SD_MM)
        own = (_MODEL, given.noise_gwt / measured, _EXPONENT * TOUCH_SD_MM / depth_mm)
        foreseen = band(np.maximum(forces, _LEAST_GWT), float(np.linalg.norm(own)))
        return Surprise(foreseen, float(np.log(foreseen.high / foreseen.low) / (2 * standard_deviations())), measured)

    @property
    def not_learned(self) -> list[str]:
        """What eight presses, or so, did not tell, in sentences."""
        said = [f"{self.stranger}"] if self.stranger else []
        if self.learned.collapsed:
            said.append(
                f"the estimate has collapsed onto {self.learned.effective:.1f} effective draws of "
                f"{len(self.learned.draws)}, so the bands below are meaningless"
            )
        for goal, before, now in zip(self.wanted.goals, self.widths_before, self.widths, strict=True):
            if now.half > self.wanted.width:
                known = (
                    f"the force of {goal.indentor} at {goal.x_mm:+.2f} mm to {goal.doi_mm:.2f} mm is known only to "
                )
                hardly = ", hardly better than before the presses" if now.half > _LEAST_NARROWER * before.half else ""
                said.append(f"{known}± {100 * now.half:.0f} % (requested: ± {100 * self.wanted.width:g} %){hardly}")
        prior = self.foreseen.prior
        left = self.learned.draws.std(axis=0) / self.before.draws.std(axis=0)
        wide = [name for name, share in zip(prior.names, left, strict=True) if share > _NOT_LEARNED_SHARE]
        return [*said, *(f"{named(name)} is known hardly better than before the presses" for name in wide)]
