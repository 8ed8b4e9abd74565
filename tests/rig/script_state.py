"""Scripts walked through beside a stand-in for the finger model: what is refused, foreseen and handed on."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import pytest

from rig.errors import BadInputError
from rig.protocol import Rig
from rig.protocol.api import ProtocolParameters
from rig.protocol.check import NoPredictionError, PressPlace, ScriptState
from rig.protocol.steps import Step
from rig.records import Pace, Prediction, Target
from rig.settings import RigSettings


@dataclass(frozen=True)
class StandIn:
    """A finger with F = gwt_mm · DOI, whatever presses it; it is touched at contact_mm and carries by area_mm2.

    It knows bar and step, and has no answer where x is 5.
    """

    gwt_mm: float = 10.0
    contact_mm: float = -0.3
    area_mm2: float = 40.0

    def refuse_shape(self, indentor: str) -> None:
        """Every other name is that of no indentor."""
        if indentor not in ("bar", "step"):
            raise BadInputError(f"shape {indentor!r}: expected bar or step", "no_shape")

    def press(self, indentor: str, x_mm: float, target: Target, pace: Pace | None = None) -> Prediction:
        """Linear."""
        if x_mm == 5.0:
            raise NoPredictionError("the stand-in does not know", "no_answer")
        doi_mm = target.value if target.kind == "doi_mm" else target.value / self.gwt_mm
        force_gwt = target.value if target.kind == "force_gwt" else target.value * self.gwt_mm
        return Prediction(indentor, x_mm, target, self.contact_mm, force_gwt, doi_mm, self.area_mm2, 0.1)

    def touch_height_mm(self, indentor: str, x_mm: float, along_mm: float) -> float:
        """The same everywhere."""
        return self.contact_mm


@dataclass
class Walked:
    """What a script handed on: its steps, where each stood, what each expected and what it was answered."""

    state: ScriptState
    steps: list[Step[Any, Any]] = field(default_factory=list)
    places: list[PressPlace] = field(default_factory=list)
    expected: list[Any] = field(default_factory=list)
    answers: list[Any] = field(default_factory=list)

    def handle(self, step: Step[Any, Any], place: PressPlace) -> Any:
        """As the plan does, and kept."""
        self.steps.append(step)
        self.places.append(place)
        self.expected.append(step.expect(place, self.state))
        self.answers.append(step.foreseen(self.expected[-1]))
        return self.answers[-1]


def walked(
    script: Callable[[Rig], object],
    finger: StandIn | None = None,
    settings: RigSettings | None = None,
    parameters: ProtocolParameters | None = None,
    **tables: Any,
) -> Walked:
    """ScriptState through a script; `tables` are those of the configuration. Raises BadInputError."""
    settings = settings or RigSettings.model_validate(tables)
    kept = Walked(ScriptState(settings, finger or StandIn()))
    script(Rig(parameters or ProtocolParameters(), kept.state, kept))
    return kept


def refused(script: Callable[[Rig], object], finger: StandIn | None = None, **tables: Any) -> BadInputError:
    """What the script is refused for."""
    with pytest.raises(BadInputError) as caught:
        walked(script, finger, **tables)
    return caught.value


def ready(rig: Rig, x_mm: float = 0.0) -> Rig:
    """Mounted, homed, zeroed and over a place."""
    rig.mount("bar")
    rig.home()
    rig.zero()
    rig.move_to(x_mm=x_mm)
    return rig
