"""What a run promised of a finger that was met, and what it found."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from rig.data import Run
from rig.engine.records import Purpose
from rig.plan.plan import Plan
from rig.protocol.planned import PlannedIndentation

_PREFIX: Mapping[str, str] = {"data": "", "precondition": "precondition_", "reference": "reference_"}


@dataclass(frozen=True)
class Promise:
    """The band of what a press does not control: the force at a depth (gwt), the depth at a force (mm)."""

    purpose: Purpose
    index: int
    key: str  # of hold_end
    low: float
    middle: float
    high: float


@dataclass(frozen=True)
class Found:
    """A promise beside what was measured in the last hold."""

    promise: Promise
    indentor: str
    x_mm: float
    measured: float

    @property
    def kept(self) -> bool:
        """Whether it lies in the band."""
        return self.promise.low <= self.measured <= self.promise.high


def promised(plan: Plan) -> list[dict[str, Any]]:
    """As the run's first document says it; nothing of a finger that nobody met."""
    return [
        asdict(_promise(purpose, index, press))
        for purpose, presses in plan.presses.items()
        for index, press in enumerate(presses)
        if press.band is not None
    ]


def _promise(purpose: Purpose, index: int, press: PlannedIndentation) -> Promise:
    assert press.band is not None
    if press.target.kind == "doi_mm":
        low, high = press.band.force_gwt
        return Promise(purpose, index, "force_gwt", low, press.predicted_force_gwt, high)
    low, high = press.band.doi_mm
    return Promise(purpose, index, "doi_mm", low, press.predicted_doi_mm, high)


def found(run: Run) -> list[Found]:
    """Of every press that was promised and finished."""
    pairs = []
    for promise in (Promise(**one) for one in run.start.get("promised", [])):
        prefix = _PREFIX[promise.purpose]
        begun = [e for e in run.stream(f"{prefix}indentation_start") if e["index"] == promise.index]
        holds = [e for e in run.stream(f"{prefix}hold_end") if e["index"] == promise.index]
        if begun and len(holds) == begun[0]["increments"]:
            pairs.append(Found(promise, begun[0]["indentor"], begun[0]["x_mm"], holds[-1][promise.key]))
    return pairs
