"""The numbers behind the figures that are the finger model's, as tidy CSV beside those of the journal."""

import csv
import io
from collections.abc import Iterable, Sequence
from pathlib import Path

from rig.data import Run
from rig.data.dictionary import MODEL_TABLES, OF_A_HOLD
from rig.data.folder import replace_text
from rig.data.run_tables import tables
from rig.plan.responses import Response
from sim.measures.measures import MEASURES

COLUMNS = {
    name: tuple(OF_A_HOLD) + (("receptor_x_mm", *MEASURES) if name == "model_measures" else tuple(own))
    for name, own in MODEL_TABLES.items()
}
"""Of each file, in order."""


def numbers_missing(run: Run) -> bool:
    """Whether a file is not there."""
    return not all(_file(run, name).exists() for name in COLUMNS)


def write_numbers(run: Run, found: Sequence[Response], *, again: bool = True) -> None:
    """Write contact regions, pressure and skin in the receptor plane, and receptor measures of every hold.

    again: also what is there.
    """
    holds = {(row["index"], row["hold"]): row for row in tables(run)["hold_end"].rows}
    rows_of = {"model_contact": _contact, "model_pressure": _pressure, "model_measures": _measures}
    for name, rows in rows_of.items():
        if not again and _file(run, name).exists():
            continue
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(COLUMNS[name])
        for response in found:
            hold = holds[response.index, response.hold["hold"]]
            of_a_hold = [hold.get(column) for column in OF_A_HOLD]
            writer.writerows([*of_a_hold, *row] for row in rows(response))
        replace_text(_file(run, name), text.getvalue())


def _file(run: Run, name: str) -> Path:
    return run.folder.path / f"{name}.csv"


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
