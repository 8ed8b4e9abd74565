"""State of an identification: the next press, the estimate so far, and whether it suffices; moves nothing."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from rig.plan.config import Config
from rig.plan.plan import SMALLEST_SOFT_TRIP_N, SOFT_TRIP_OVER_BAND
from rig.records import BETWEEN_INCREMENTS_S
from rig.settings import RigSettings
from rig.units import GWT_N
from sim.errors import ModelRangeError
from sim.identification.next_press import PressAt, PressSelector, SkinSearch, highest_gwt
from sim.identification.posterior import PRESS_ERROR, SHAPE_ERROR, Surprise, learn, no_finger, nothing_learned
from sim.identification.predicted_forces import MeasuredPress, PredictedForces, RampAndHold
from sim.identification.prior import named
from sim.identification.uncertainty_bands import Width, band, standard_deviations

SHAPES = ("sphere:4", "flat:3", "bar:3.0")
PLACES_MM = (-1.2, 0.0, 1.2)
DEPTHS_MM = (0.2, 0.3, 0.45, 0.6, 0.8, 1.0)
BEYOND_DEPTH = 1.1
"""Depth to which forces are predicted, relative to the depth of a press: a touch may find the skin too high."""

_GENTLE = (0.25, 0.5)  # share of the largest force that the first presses may reach
_TRIP_SHARE = 0.995  # share of the likely fingers whose force stays below the trip
_LEAST_NARROWER = 0.9  # a larger ratio of widths after and before the presses counts as not learned
_NOT_LEARNED_SHARE = 0.8  # a larger ratio of a parameter's sd after and before counts as not learned
_LEAST_PRESSES = 4  # fewer presses can neither confirm nor reject a finger
_LEAST_GWT, _EXPONENT = 1e-3, 1.7
_MODEL = float(np.hypot(PRESS_ERROR, SHAPE_ERROR))

TOUCH_SD_MM = 0.015
"""Standard deviation of the skin height that a touch finds, for a cell with 0.02 gwt of noise (mm)."""

TOUCH_GWT = 0.1
"""Smallest touch force (gwt): five times the noise of a cell, because the fit corrects the height of the skin."""

MODEL_ERROR, USUAL_MISFIT = 0.018, 0.8
"""Relative standard deviation of a force under a shape that was not pressed, in addition to the spread of the likely
fingers; and the usual misfit of the most likely finger, squared standardized distance per reading
(docs/identify.md)."""


@dataclass(frozen=True)
class IdentificationOptions:
    """Goals and limits of an identification: forces to predict and their half-width, presses, force and hold."""

    goals: tuple[PressAt, ...]
    width: float = 0.08
    presses: int = 8
    most_gwt: float = 20.0
    shapes: tuple[str, ...] = SHAPES
    hold_s: float = 1.5

    @property
    def indentors(self) -> tuple[str, ...]:
        """All shapes of presses and goals, each once."""
        return tuple(dict.fromkeys([*self.shapes, *(goal.indentor for goal in self.goals)]))


def with_reliable_touch(config: Config) -> Config:
    """Return the configuration with a touch force that noise does not reach."""
    force_gwt = max(config.habits.touch_force_gwt, TOUCH_GWT)
    return config.model_copy(update={"habits": config.habits.model_copy(update={"touch_force_gwt": force_gwt})})


@dataclass(frozen=True)
class PressReport:
    """Report of one press."""

    number: int
    press: PressAt
    surprise: Surprise
    trip_gwt: float  # soft trip during this press
    widest: float  # relative half-width of the least certain goal after this press


@dataclass
class Identification:
    """Estimate of a finger after some presses. Raises ModelRangeError for a goal that is too deep."""

    settings: RigSettings
    predicted: PredictedForces
    options: IdentificationOptions
    seed: int = 0
    measured: list[MeasuredPress] = field(default_factory=list)
    reports: list[PressReport] = field(default_factory=list)

    def __post_init__(self) -> None:
        habits = self.settings.habits
        pace = RampAndHold(habits.increment_mm, habits.increment_mm / habits.press_speed_mm_s + BETWEEN_INCREMENTS_S)
        self._menu = [PressAt(s, x, d) for s in self.options.shapes for x in PLACES_MM for d in self._depths_mm(s)]
        search = SkinSearch(self.settings.limits.search_mm - habits.increment_mm, habits.touch_force_gwt)
        self.chooser = PressSelector(self.predicted, self.options.goals, pace, search)
        for goal in self.options.goals:
            if goal.doi_mm > self._deepest_mm(goal.indentor):
                raise ModelRangeError(
                    f"{goal.indentor} to {goal.doi_mm:.2f} mm: the model predicts its force only to "
                    f"{self._deepest_mm(goal.indentor):.2f} mm; choose a smaller depth or a wider patch of the "
                    "mesh",
                    "goal_too_deep",
                )
        self._chance = np.random.default_rng(self.seed)
        self.learned = self.before = nothing_learned(self.predicted.prior, self._chance)
        self.widths_before = self.widths

    def _depths_mm(self, shape: str) -> Sequence[float]:
        deepest_mm = min(self.settings.limits.max_doi_mm, self._deepest_mm(shape) / BEYOND_DEPTH)
        return [d for d in DEPTHS_MM if d <= deepest_mm + 1e-9]

    def _deepest_mm(self, shape: str) -> float:
        return self.predicted.table(shape).scope.depth_mm[1]

    @property
    def widths(self) -> list[Width]:
        """Predicted force of each goal with its band."""
        return self.chooser.goal_widths(self.learned, self.own_error)

    @property
    def own_error(self) -> float:
        """Relative sd of a force in addition to the spread, widened for a large misfit (Birge ratio)."""
        readings = max(int(self.learned.readings.sum()), 1)
        return MODEL_ERROR * math.sqrt(max(self.learned.total / (USUAL_MISFIT * readings), 1.0))

    @property
    def widest(self) -> float:
        """Relative half-width of the least certain goal."""
        return max(width.half for width in self.widths)

    @property
    def enough(self) -> bool:
        """Whether the identification is finished."""
        if len(self.reports) < min(_LEAST_PRESSES, self.options.presses):
            return False
        precise = self.reports[-1].widest <= self.options.width
        return precise or len(self.reports) >= self.options.presses or self.mismatch is not None

    @property
    def mismatch(self) -> str | None:
        """Reason why no finger of the prior explains the presses; None if one does."""
        return no_finger(self.predicted, self.measured, self.learned, [report.surprise for report in self.reports])

    @property
    def flag(self) -> Literal["collapsed", "no_finger"] | None:
        """Code of an identification whose bands are not to be used; None if they are."""
        if self.learned.collapsed:
            return "collapsed"
        return None if self.mismatch is None else "no_finger"

    def next(self) -> PressAt:
        """Return the most informative press: light presses first, and each shape once before any is repeated."""
        share = _GENTLE[len(self.reports)] if len(self.reports) < len(_GENTLE) else 1.0
        pressed = {report.press.indentor for report in self.reports}
        new = [press for press in self._menu if press.indentor not in pressed] or self._menu
        return self.chooser.choose(self.learned, share * self.options.most_gwt, new)

    def trip_n(self, press: PressAt) -> float:
        """Return the soft trip of a press (N), from the upper end of its predicted band."""
        return max(SOFT_TRIP_OVER_BAND * self.highest_gwt(press) * GWT_N, SMALLEST_SOFT_TRIP_N)

    def highest_gwt(self, press: PressAt) -> float:
        """Return the upper end of the predicted band of a press (gwt)."""
        return float(highest_gwt(self.predicted, self.learned.draws, press, self.chooser.pace, _TRIP_SHARE))

    def take(self, press: PressAt, measured: MeasuredPress) -> PressReport:
        """Update the estimate with a measured press and return its report."""
        surprise, trip_gwt = self._surprise(measured), self.trip_n(press) / GWT_N
        self.measured.append(measured)
        self.learned = learn(self.predicted, self.measured, self.learned, self._chance)
        self.reports.append(PressReport(len(self.reports) + 1, press, surprise, trip_gwt, self.widest))
        return self.reports[-1]

    @property
    def explained(self) -> list[tuple[Width, float]]:
        """Highest force of each press: its band for the likely fingers, and the measured one (gwt)."""
        found = []
        for measured in self.measured:
            peak = int(np.argmax(measured.force_gwt))
            forces = self.predicted.forces_gwt(self.learned.draws, measured.by_depth)[:, peak]
            width = band(np.maximum(forces, _LEAST_GWT), self.own_error)
            found.append((width, float(measured.force_gwt[peak])))
        return found

    def _surprise(self, measured: MeasuredPress) -> Surprise:
        peak = int(np.argmax(measured.force_gwt))
        highest_gwt = max(float(measured.force_gwt[peak]), _LEAST_GWT)
        trajectory = measured.by_depth
        forces = self.predicted.forces_gwt(self.learned.draws, trajectory)[:, peak]
        depth_mm = max(-float(trajectory.height_mm.min()), TOUCH_SD_MM)
        own = (_MODEL, measured.noise_gwt / highest_gwt, _EXPONENT * TOUCH_SD_MM / depth_mm)
        predicted = band(np.maximum(forces, _LEAST_GWT), float(np.linalg.norm(own)))
        return Surprise(
            predicted, float(np.log(predicted.high / predicted.low) / (2 * standard_deviations())), highest_gwt
        )

    @property
    def not_learned(self) -> list[str]:
        """Quantities that the presses did not determine, as sentences."""
        problems = [f"{self.mismatch}"] if self.mismatch else []
        if self.learned.collapsed:
            problems.append(
                f"the estimate has collapsed onto {self.learned.effective:.1f} effective draws of "
                f"{len(self.learned.draws)}, so the bands below are meaningless"
            )
        for goal, before, now in zip(self.options.goals, self.widths_before, self.widths, strict=True):
            if now.half > self.options.width:
                force = (
                    f"the force of {goal.indentor} at {goal.x_mm:+.2f} mm to {goal.doi_mm:.2f} mm is known only to "
                )
                hardly = ", hardly better than before the presses" if now.half > _LEAST_NARROWER * before.half else ""
                problems.append(
                    f"{force}± {100 * now.half:.0f} % (requested: ± {100 * self.options.width:g} %){hardly}"
                )
        prior = self.predicted.prior
        left = self.learned.draws.std(axis=0) / self.before.draws.std(axis=0)
        wide = [name for name, share in zip(prior.names, left, strict=True) if share > _NOT_LEARNED_SHARE]
        return [*problems, *(f"{named(name)} is known hardly better than before the presses" for name in wide)]
