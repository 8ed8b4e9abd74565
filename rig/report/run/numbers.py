"""The numbers behind the figures that are the finger model's, as tidy CSV beside those of the journal."""

import csv
import io
from collections.abc import Iterable, Sequence

from rig.data import Run
from rig.data.folder import replace_text
from rig.plan.responses import Response
from sim.measures.measures import MEASURES

_PRESS = ("index", "hold", "indentor", "x_mm", "block", "repeat", "condition")

COLUMNS = {
    "model_contact": (*_PRESS, "doi_mm", "force_gwt", "peak_pressure_pseudo", "region", "from_x_mm", "to_x_mm"),
    "model_pressure": (*_PRESS, "undeformed_x_mm", "skin_x_mm", "skin_y_mm", "pressure_pseudo"),
    "model_measures": (*_PRESS, "receptor_x_mm", *MEASURES),
}
"""Of each file; pressures and stresses in pseudo-units, measures with tension positive."""


def write_numbers(run: Run, found: Sequence[Response]) -> None:
    """Write contact regions, pressure and skin in the receptor plane, and receptor measures of every hold."""
    rows = {"model_contact": _contact, "model_pressure": _pressure, "model_measures": _measures}
    marks = {event["index"]: event for event in run.stream("indentation_start")}
    for name, of in rows.items():
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(COLUMNS[name])
        for response in found:
            start = marks[response.index]
            press = [response.index, response.hold["hold"], response.indentor, response.hold["x_mm"]]
            press += [start.get(key) for key in ("block", "repeat", "condition")]
            writer.writerows([*press, *row] for row in of(response))
        replace_text(run.folder.path / f"{name}.csv", text.getvalue())


Rows = Iterable[Sequence[object]]


def _contact(response: Response) -> Rows:
    result = response.result
    whole = (_digits(result.doi_mm), _digits(result.force_gwt), _digits(result.peak_pressure_pseudo))
    return [(*whole, k, _digits(a), _digits(b)) for k, (a, b) in enumerate(result.contact_regions_mm, 1)]


def _pressure(response: Response) -> Rows:
    (x, pressure), (skin_x, skin_y) = response.result.pressure_profile, response.result.skin_profile
    return [tuple(map(_digits, row)) for row in zip(x, skin_x, skin_y, pressure, strict=True)]


def _measures(response: Response) -> Rows:
    receptors = response.result.model.receptors.position_mm[:, 0]
    values = [response.result.receptor_measures[measure] for measure in MEASURES]
    return [tuple(map(_digits, row)) for row in zip(receptors, *values, strict=True)]


def _digits(value: float) -> str:
    return f"{value:.7g}"
