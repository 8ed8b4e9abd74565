"""The request of a design, as its script carries it: written by `rig design`, read by its `Chooser`."""

import json
from dataclasses import asdict, dataclass
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError

from rig.compare.plausible_fingers import PlausibleFingers
from rig.design.design import DesignRequest
from rig.design.exceptions import DesignError
from rig.design.fibers import Range, Unknowns
from rig.design.presses import Kind, PossiblePress, planned_presses, possible_presses
from rig.errors import first_problem
from sim.contact.shapes import parse_shape

_OWN = ("hold_s", "rest_s", "quick")  # parameters of the script, and of no use in a run


class _Unknowns(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    rate_per_s: Range
    threshold: Range
    x_mm: Range
    below_mm: Range
    dispersion: Range
    drift: float


class _Block(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    candidates: tuple[str, ...]
    shapes: tuple[str, ...]
    minutes: float
    kind: Kind
    targets: tuple[float, ...]
    unknowns: _Unknowns
    change_s: float
    seed: int
    fingers: dict[str, Range] | None = None


@dataclass(frozen=True)
class Designed:
    """Design that a script carries: the request, the plausible fingers, and the planned presses."""

    request: DesignRequest
    plausible: PlausibleFingers | None
    planned: tuple[PossiblePress, ...]

    @classmethod
    def of(cls, design: Any, blocks: Any, *, hold_s: float, rest_s: float) -> "Designed":
        """Return the design that the blocks of a script describe.

        Raises DesignError if a block is wrong, and ShapeError for an unknown shape.
        """
        try:
            block = _Block.model_validate(design)
        except ValidationError as error:
            problem = first_problem("DESIGN", error, _Block)
            raise DesignError(str(problem), problem.code) from None
        planned = planned_presses(design, blocks)
        values: dict[str, Any] = block.model_dump()
        fingers, unknowns = values.pop("fingers"), Unknowns(**values.pop("unknowns"))
        held: dict[str, Any] = {"hold_s": float(hold_s), "rest_s": float(rest_s)}
        request = DesignRequest(**values, unknowns=unknowns, **held)
        request.refuse()
        possible = set(possible_presses(request.shapes, request.kind, request.targets))
        for press in planned:
            if press.shape not in request.shapes:
                parse_shape(press.shape)
            if press not in possible:
                raise DesignError(
                    f"BLOCKS: {press.title} is none of the presses of DESIGN; design the session again",
                    "press_not_designed",
                )
        plausible = None if fingers is None else PlausibleFingers("DESIGN", fingers)
        return cls(request, plausible, planned)


def as_block(request: DesignRequest, plausible: PlausibleFingers | None) -> str:
    """Return the block DESIGN of a script."""
    values = {key: value for key, value in asdict(request).items() if key not in _OWN}
    values["unknowns"] = request.unknowns._asdict()
    if plausible is not None:
        values["fingers"] = plausible.ranges
    lines = [f"    {json.dumps(key)}: {json.dumps(value)},\n" for key, value in values.items()]
    return "DESIGN = {\n" + "".join(lines) + "}"
