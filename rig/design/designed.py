"""The request of a design, as its script carries it: written by `rig design`, read by `rig run --choose`."""

import json
from dataclasses import asdict, dataclass
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError

from rig.compare.plausible_fingers import PlausibleFingers
from rig.design.design import DesignRequest
from rig.design.exceptions import DesignError
from rig.design.fibers import Range, Unknowns
from rig.design.presses import Kind, PossiblePress, possible_presses
from rig.errors import first_problem
from rig.protocol.script import Script
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
    def of(cls, script: Script) -> "Designed":
        """Return the design that a script carries.

        Raises DesignError if it is no designed script or a block is wrong, and ShapeError for an unknown shape.
        """
        if script.design is None:
            raise DesignError(
                f"--choose: {script.path.name} has no DESIGN; write a script with `rig design`", "no_design"
            )
        try:
            block = _Block.model_validate(script.design["DESIGN"])
            planned = _planned(script.design["BLOCKS"], block.kind)
        except ValidationError as error:
            problem = first_problem(f"{script.path.name}, DESIGN", error, _Block)
            raise DesignError(str(problem), problem.code) from None
        except (TypeError, ValueError):
            raise DesignError(
                f"{script.path.name}, BLOCKS: must be shapes, each with pairs of numbers", "bad_blocks"
            ) from None
        values: dict[str, Any] = block.model_dump()
        fingers, unknowns = values.pop("fingers"), Unknowns(**values.pop("unknowns"))
        found = script.parameters.model_dump()
        held: dict[str, Any] = {key: float(found[key]) for key in ("hold_s", "rest_s") if key in found}
        if not held.get("hold_s", 1.0) > 0:
            raise DesignError("--set hold_s=0: counts need a hold, more than 0 s", "no_hold")
        request = DesignRequest(**values, unknowns=unknowns, **held)
        request.refuse()
        possible = set(possible_presses(request.shapes, request.kind, request.targets))
        for press in planned:
            if press.shape not in request.shapes:
                parse_shape(press.shape)
            if press not in possible:
                raise DesignError(
                    f"{script.path.name}, BLOCKS: {press.title} is none of the presses of DESIGN; design the "
                    "session again",
                    "press_not_designed",
                )
        plausible = None if fingers is None else PlausibleFingers(f"{script.path.name}, DESIGN", fingers)
        return cls(request, plausible, planned)


def _planned(blocks: Any, kind: Kind) -> tuple[PossiblePress, ...]:
    return tuple(
        PossiblePress(str(shape), float(x_mm), kind, float(target))
        for shape, pairs in blocks
        for x_mm, target in pairs
    )


def as_block(request: DesignRequest, plausible: PlausibleFingers | None) -> str:
    """Return the block DESIGN of a script."""
    values = {key: value for key, value in asdict(request).items() if key not in _OWN}
    values["unknowns"] = request.unknowns._asdict()
    if plausible is not None:
        values["fingers"] = plausible.ranges
    lines = [f"    {json.dumps(key)}: {json.dumps(value)},\n" for key, value in values.items()]
    return "DESIGN = {\n" + "".join(lines) + "}"
