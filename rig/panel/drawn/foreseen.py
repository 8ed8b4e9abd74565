"""What the finger model says of the press that goes on: force against depth, and the skin at its target."""

from typing import Any

import numpy as np

from rig.errors import code_of
from rig.panel.drawn.job import Press
from rig.panel.drawn.outlines import points
from sim.contact.indentor import Indentor
from sim.errors import ModelRangeError
from sim.models.fingertip import Fingertip
from sim.models.result import IndentationResult

DEPTHS = 8
NONE: dict[str, Any] = {"doi_mm": None, "force_gwt": None}


def foreseen(finger: Fingertip, shape: Indentor, press: Press) -> tuple[dict[str, Any], dict[str, Any]]:
    """Of `prediction` the curve up to the target, of `section` skin and contact there; empty where there is none."""
    try:
        x_mm, ways = shape.lateral_mm(press.x_mm), finger.keeping_ways()
        last = ways.indent(shape, x_mm, **{press.target: press.value})  # type: ignore[arg-type]
        depths = last.doi_mm * np.arange(1, DEPTHS) / DEPTHS
        found = [ways.indent(shape, x_mm, doi_mm=float(doi_mm)) for doi_mm in depths]
    except ModelRangeError as error:
        return {**NONE, "problem": str(error), "code": code_of(error)}, {}
    curve = [one for one in [*found, last] if one.state.converged]
    told = {"doi_mm": [0.0, *(one.doi_mm for one in curve)], "force_gwt": [0.0, *(one.force_gwt for one in curve)]}
    return told, _at_target(last, finger.apex_height_mm) if last.state.converged else {}


def _at_target(found: IndentationResult, apex_mm: float) -> dict[str, Any]:
    x, y = found.skin_profile
    return {
        "contact": [list(region) for region in found.contact_regions_mm],
        "pressed_skin": points(x, y - apex_mm),
    }
