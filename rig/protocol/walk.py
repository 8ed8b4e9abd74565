"""The walk through a script: where it has come to, and what the finger model is asked on the way."""

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from rig.engine.pressing.reference import Reference
from rig.engine.records import PressId, Purpose, Target
from rig.engine.rig_settings import RigSettings
from rig.errors import RigError
from rig.protocol.errors import BadInputError
from rig.protocol.planned import Pace, Prediction


class NoPredictionError(RigError):
    """The model has no answer that could be relied upon."""

    default_code = "no_prediction"


class ForceTooDeepError(NoPredictionError):
    """The force is not reached at any depth that is allowed."""

    default_code = "force_out_of_reach"


class Model(Protocol):
    """The finger, as far as a script's steps need it."""

    def refuse_shape(self, indentor: str) -> None:
        """Raise where this is the name of no indentor."""

    def press(self, indentor: str, x_mm: float, target: Target, pace: Pace | None = None) -> Prediction:
        """What a press at a pace meets; one that was asked for before costs nothing. Raises NoPredictionError."""

    def touch_height_mm(self, indentor: str, x_mm: float, along_mm: float) -> float:
        """Height of the indentor at first touch, from the nominal apex."""


@dataclass(frozen=True)
class Spot:
    """Where a step stands in the walk: the place, and the numbers of the presses that it makes there."""

    indentor: str
    x_mm: float
    along_mm: float
    ids: tuple[PressId, ...]


class Walk:
    """What a script has done so far, as far as the next step depends on it; each pass over a script has its own."""

    def __init__(self, settings: RigSettings, model: Model) -> None:
        self.settings, self.model = settings, model
        self.indentor: str | None = None
        self.x_mm, self.along_mm = math.nan, 0.0
        self.homed = self.zeroed = False
        self.checkpoints: set[str] = set()
        self.pressed: Counter[Purpose] = Counter()
        self.held_s = 0.0
        self.reference_asked: tuple[Any, ...] | None = None
        self.reference = Reference()  # what the references of this pass are compared with

    def need(self, condition: bool, verb: str, before: str) -> None:
        """Refuse a verb before which another must come."""
        if not condition:
            raise BadInputError("{verb}: {before} must come first", code="comes_too_early", verb=verb, before=before)

    def need_ready(self, verb: str) -> None:
        """Refuse to touch anything unless mounted, zeroed and placed."""
        self.need(self.indentor is not None, verb, "mount()")
        self.need(self.zeroed, verb, "zero()")
        self.need(math.isfinite(self.x_mm), verb, "move_to()")

    def hold(self, verb: str, held_s: float) -> None:
        """The finger is held for so long; refuse what is too long in all."""
        self.held_s += held_s
        longest_s = self.settings.limits.max_contact_s
        if self.held_s > longest_s:
            raise BadInputError(
                "{verb}: the finger would be held for {held_s:g} s in all, beyond limits.max_contact_s = {high:g}",
                code="held_too_long",
                verb=verb,
                held_s=self.held_s,
                high=longest_s,
            )

    def spot(self, purpose: Purpose = "data", presses: int = 0, marks: Mapping[str, Any] | None = None) -> Spot:
        """Here and now, with the next numbers for so many presses."""
        first = self.pressed[purpose]
        self.pressed[purpose] += presses
        ids = tuple(PressId(first + n, purpose, marks or {}) for n in range(presses))
        return Spot(self.indentor or "", self.x_mm, self.along_mm, ids)
