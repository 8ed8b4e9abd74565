"""What the report of a run says beside its figures: repeats together, time, limits, devices, numbers in files."""

import csv
import math
import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rig.data import Run
from rig.data.tables import booked_s, spans
from rig.plan.finger_model import responses
from rig.report.run_figures import PHASES
from rig.report.run_report import write_report
from rig.report.run_tables import (
    COLUMNS,
    by_target,
    condition_rows,
    conditions,
    limits,
    loading,
    write_numbers,
)
from sim.measures.measures import MEASURES
from sim.models.fingertip import Fingertip

TRIP = {"soft_trip_n": 0.0490332500}  # 5 gwt
HOLD = {"x_mm": 0.0, "force_gwt": 1.0, "doi_mm": 0.2}


def run_of(presses: list[dict[str, Any]], samples: list[dict[str, Any]], **start: Any) -> Run:
    """Indentations that are done, each after its one hold, and readings."""
    starts = [{"increments": 1, "target": "doi_mm", "value": 0.3, "t_s": 0.0, **press} for press in presses]
    ends = [{"index": press["index"], "hold": 1, "t_s": 1.0, **HOLD} for press in presses]
    events = {"indentation_start": starts, "hold_end": ends, "sample": samples}
    return Run(Path(), {"t_s": 0.0, "planned_indentations": 9, **start}, None, {}, events, {}, 9.0, 9.0)  # type: ignore[arg-type]


def reading(index: int, doi_mm: float | None, force_gwt: float, phase: str = "press", **more: Any) -> dict[str, Any]:
    return {"index": index, "doi_mm": doi_mm, "force_gwt": force_gwt, "phase": phase, "t_s": 0.0, **more}


# --- repeats ---


def test_repeats_are_one_condition_whatever_came_between() -> None:
    bar = {"indentor": "bar:3.0", "x_mm": 0.5}
    presses = [
        {"index": 0, **bar},
        {"index": 1, **bar, "x_mm": -0.5},
        {"index": 2, **bar, "value": 0.4},
        {"index": 3, **bar, "indentor": "bar:1.5"},
        {"index": 4, **bar, "target": "force_gwt"},
        {"index": 5, **bar},
    ]
    found = conditions(run_of(presses, []))
    assert [(c.group, c.place, c.indices) for c in found] == [
        ("bar:1.5 to 0.3 mm", "x = 0.50", (3,)),
        ("bar:3.0 to 0.3 mm", "x = −0.50", (1,)),
        ("bar:3.0 to 0.3 mm", "x = 0.50", (0, 5)),
        ("bar:3.0 to 0.4 mm", "x = 0.50", (2,)),
        ("bar:3.0 to 0.3 gwt", "x = 0.50", (4,)),
    ]
    assert [len(members) for members in by_target(found).values()] == [1, 2, 1, 1]


@pytest.mark.parametrize(
    "order",
    ["depths at each place", "shapes within places"],
)
def test_each_target_has_all_of_its_places_in_whatever_order_they_were_pressed(order: str) -> None:
    places, depths, shapes = (-1.0, 0.0, 1.0, 2.0), (0.4, 0.9), ("bar:3.0", "cylinder:9")
    nested = {
        "depths at each place": [(s, x, d) for s in shapes for x in places for d in depths],
        "shapes within places": [(s, x, d) for x in places for d in depths for s in shapes],
    }[order]
    presses = [{"index": k, "indentor": s, "x_mm": x, "value": d} for k, (s, x, d) in enumerate(nested)]
    found = by_target(conditions(run_of(presses, [])))
    assert {name: [condition.x_mm for condition in members] for name, members in found.items()} == {
        f"{shape} to {depth:g} mm": list(places) for shape in shapes for depth in depths
    }


def test_the_mean_force_of_repeats_is_at_depths_that_all_reached() -> None:
    """Two repeats on lines of slope 10 and 12 gwt/mm; readings of approach, and a hold's, do not bend them."""
    samples = [
        *(reading(0, None, 0.0, "approach"), reading(0, 0.1, 1.0), reading(0, 0.3, 3.0), reading(0, 0.4, 4.0)),
        *(
            reading(1, 0.2, 2.4),
            reading(1, 0.3, 3.5),
            reading(1, 0.3, 3.7, "hold"),
            reading(1, 0.35, 9.0, "touch"),
        ),
    ]
    run = run_of([{"index": k, "indentor": "bar:3.0", "x_mm": 0.0} for k in (0, 1)], samples)
    (condition,) = conditions(run)
    found = loading(condition, run)
    assert found is not None
    assert (found.doi_mm[0], found.doi_mm[-1]) == (0.2, 0.3)
    np.testing.assert_allclose(found.mean_gwt, 11 * found.doi_mm, rtol=1e-12)
    np.testing.assert_allclose(found.sd_gwt, 2 * found.doi_mm / math.sqrt(2), rtol=1e-12)


def test_a_row_has_mean_and_sd_of_its_repeats(bar_run: Run, finger: Fingertip) -> None:
    first = next(response for response in responses(bar_run, finger) if response.last)
    again = replace(first, index=77, hold={**first.hold, "force_gwt": first.hold["force_gwt"] + 0.2})
    begun = next(start for start in bar_run.stream("indentation_start") if start["index"] == first.index)
    events = {
        "indentation_start": [begun, {**begun, "index": 77}],
        "hold_end": [{**response.hold, "index": response.index} for response in (first, again)],
    }
    (row,) = condition_rows(replace(bar_run, events=events), [first, again])
    assert row.times == 2
    assert row.force == f"{first.hold['force_gwt'] + 0.1:.2f} ± 0.14"
    assert row.doi == f"{first.hold['doi_mm']:.3f} ± 0.000"
    assert row.regions_mm == first.result.contact_regions_mm


# --- time, limits, devices ---


def test_spans_are_the_whole_run_one_after_another(bar_run: Run) -> None:
    found = sorted(spans(bar_run), key=lambda span: (span.begin_s, span.end_s))
    assert found[0].begin_s == bar_run.start["t_s"]
    assert all(a.end_s == b.begin_s for a, b in pairwise(found))
    assert sum(span.end_s - span.begin_s for span in found) == pytest.approx(sum(booked_s(bar_run).values()))
    assert set(PHASES) <= {span.what for span in found}


def test_limits_stand_beside_what_came_nearest(tmp_path: Path, bar_run: Run) -> None:
    samples = [reading(0, 0.2, 2.0), reading(0, 0.31, 3.0), reading(0, None, 0.1)]
    run = replace(run_of([], samples, **TRIP), folder=bar_run.folder)
    found = dict(limits(run))
    assert found["soft trip of this run"] == "5.00 gwt (0.0490 N)"
    assert found["highest measured force"] == "3.00 gwt (0.0294 N)"
    assert found["deepest"] == "0.310 mm"
    assert found["limits.hard_trip_n"] == "5"
    assert found["limits.max_doi_mm"] == "1.5"


# --- the page and its numbers ---


def test_every_figure_has_its_numbers_in_a_file(bar_run: Run, finger: Fingertip) -> None:
    page = write_report(bar_run, finger).read_text(encoding="utf-8")
    captions = re.findall(r"<figcaption>(.*?)</figcaption>", page, flags=re.DOTALL)
    assert len(captions) == page.count("<img") >= 4
    for caption in captions:
        named = re.findall(r"\w+\.csv", caption)
        assert named or caption.startswith("The same for")
        assert all((bar_run.folder.path / name).exists() for name in named)
    titles = re.findall(r"<h2[^>]*>(.*?)</h2>", page)
    assert titles[:2] == ["What ran", "Force against time"]


def test_the_numbers_are_the_models(bar_run: Run, finger: Fingertip) -> None:
    found = responses(bar_run, finger)
    write_numbers(bar_run, found)
    tables = {name: _table(bar_run.folder.path / f"{name}.csv") for name in COLUMNS}
    for name, rows in tables.items():
        assert list(rows[0]) == list(COLUMNS[name])
        assert {row["indentor"] for row in rows} == {response.indentor for response in found}
        assert {(row["index"], row["hold"]) for row in rows} == {
            (str(response.index), str(response.hold["hold"])) for response in found
        }
    response = found[-1]
    press = {"index": str(response.index), "hold": str(response.hold["hold"])}
    mine = {name: [row for row in rows if press.items() <= row.items()] for name, rows in tables.items()}
    x, pressure = response.result.pressure_profile_kpa
    np.testing.assert_allclose(_column(mine["model_pressure"], "undeformed_x_mm"), x, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(_column(mine["model_pressure"], "pressure_kpa"), pressure, rtol=1e-6)
    np.testing.assert_allclose(
        _column(mine["model_pressure"], "skin_y_mm"), response.result.skin_profile[1], rtol=1e-6
    )
    for measure in MEASURES:
        expected = response.result.receptor_measures[measure]
        np.testing.assert_allclose(_column(mine["model_measures"], measure), expected, rtol=1e-6)
    ends = [(float(row["from_x_mm"]), float(row["to_x_mm"])) for row in mine["model_contact"]]
    np.testing.assert_allclose(ends, response.result.contact_regions_mm, rtol=1e-6)


def _table(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def _column(rows: list[dict[str, str]], name: str) -> list[float]:
    return [float(row[name]) for row in rows]
