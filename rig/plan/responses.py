"""What the finger model says of every hold that a run recorded."""

from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.data import Run
from rig.plan.shape_files import from_copy
from sim.contact.indentor import Indentor
from sim.contact.shapes import parse_shape
from sim.models.fingertip import Fingertip
from sim.models.result import IndentationResult

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Response:
    """One hold and the model's answer to it."""

    index: int
    indentor: str
    kind: str  # what was commanded: doi_mm or force_gwt
    commanded: float
    last: bool  # of its indentation
    hold: dict[str, Any]
    touch: dict[str, Any]
    result: IndentationResult

    @property
    def group(self) -> str:
        """What it can be compared with over positions, e.g. "step:1 at 2.33 gwt"."""
        unit = {"doi_mm": "mm", "force_gwt": "gwt"}[self.kind]
        return f"{self.indentor} at {self.commanded:g} {unit}"


def responses(run: Run, finger: Fingertip, *, last_only: bool = False) -> list[Response]:
    """One response for each hold, or each last hold, of each finished indentation, in the order of the run.

    A virtual run is answered at the true x and DOI; a run on hardware at the force it recorded.
    """
    starts = {event["index"]: event for event in run.stream("indentation_start")}
    touches = {event["index"]: event for event in run.stream("touch")}
    asked = {(event["index"], event["hold"]): event for event in run.stream("hold_start")}
    found = []
    shapes: dict[str, Indentor] = {}
    for hold in run.stream("hold_end"):
        index = hold["index"]
        last = hold["hold"] == starts[index]["increments"]
        if index not in run.done or (last_only and not last):
            continue
        indentor, start = starts[index]["indentor"], asked[index, hold["hold"]]
        if indentor not in shapes:
            shapes[indentor] = parse_shape(from_copy(run.folder.path, indentor))
        shape = shapes[indentor]
        if hold.get("true_doi_mm") is not None:
            result = finger.indent(shape, shape.lateral_mm(hold["true_x_mm"]), doi_mm=hold["true_doi_mm"])
        else:
            result = finger.indent(shape, shape.lateral_mm(hold["x_mm"]), force_gwt=hold["force_gwt"])
        found.append(
            Response(index, indentor, start["target"], start["commanded"], last, hold, touches[index], result)
        )
    return found


def by_group(found: list[Response]) -> dict[str, list[Response]]:
    """The responses that differ in position only, each list ordered by x."""
    ordered = sorted(found, key=lambda r: (r.indentor, r.kind, r.commanded, r.hold["x_mm"]))
    return {name: list(members) for name, members in groupby(ordered, key=lambda r: r.group)}


def measured(found: list[Response], measure: str) -> tuple[Array, Array]:
    """Indentor positions (n,) mm and the raw measure (n, receptors): rows are population responses, columns SSRPs."""
    x = np.array([response.hold["x_mm"] for response in found])
    return x, np.array([response.result.receptor_measures[measure] for response in found])
