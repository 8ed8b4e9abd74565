"""What the finger model says of every hold that a run recorded."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.data import Run
from sim.fingertip import Fingertip
from sim.result import IndentationResult

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Response:
    """The last hold of one indentation and the model's answer to it."""

    index: int
    indentor: str
    hold: dict[str, Any]
    touch: dict[str, Any]
    result: IndentationResult


def responses(run: Run, finger: Fingertip) -> list[Response]:
    """One response for each finished indentation, in the order of the run.

    A virtual run is answered at the true x and DOI; a run on hardware at the force it recorded.
    """
    starts = {event["index"]: event for event in run.stream("indentation_start")}
    touches = {event["index"]: event for event in run.stream("touch")}
    last = {event["index"]: event for event in run.stream("hold_end")}
    found = []
    for done in run.stream("indentation_end"):
        index = done["index"]
        hold, indentor = last[index], starts[index]["indentor"]
        if hold.get("true_doi_mm") is not None:
            result = finger.indent(indentor, hold["true_x_mm"], doi_mm=hold["true_doi_mm"])
        else:
            result = finger.indent(indentor, hold["x_mm"], force_gwt=hold["force_gwt"])
        found.append(Response(index, indentor, hold, touches[index], result))
    return found


def population(found: list[Response], measure: str) -> tuple[Array, Array]:
    """Indentor positions (n,) mm and the raw measure (n, receptors): rows are population responses, columns SSRPs."""
    x = np.array([response.hold["x_mm"] for response in found])
    return x, np.array([response.result.receptor_measures[measure] for response in found])
