"""Every figure of every page: its series are the tables that they claim to show, and what is printed is true.

`pages.py` makes the pages. A figure states its data, so that matplotlib is asked only for what is printed: texts,
their size, and limits.
"""

import ast
import csv
import json
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby, pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.collections import EventCollection, PathCollection
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.text import Text
from numpy.typing import NDArray

from rig.compare.example import recorded
from rig.compare.fit import fit_rates, predicted
from rig.compare.make_verdict import answers
from rig.compare.recordings.recording import Recording
from rig.compare.stimuli import CONTROLS, StimulusRow
from rig.compare.verdict import AfferentVerdict, FittedPositions, LeftOut
from rig.compare.verdict_text import positions
from rig.data import Run
from rig.data.tables import spans
from rig.report import page_parts, verdict_figures
from rig.report.measure_colors import color_of
from rig.report.nerve_figures import pressed
from rig.report.plot import PAGE_IN, Plot, Rows, Series
from rig.report.run_tables import conditions, loading
from rig.report.style import BLUE, DOTTED, GREEN, GREY, ORANGE, PAPER, PURPLE, YELLOW, label
from rig.report.verdict_section import answer_sections
from sim.measures.measures import MEASURES, shown
from sim.models.fingertip import Fingertip
from tests.rig.compare.pages import FIGURES, LIKELY, POSITIONS, RATE, World, made_comparison
from tests.sources import trees_with

ROOT = Path(__file__).parents[3]
REPORT = ROOT / "rig" / "report"
Array = NDArray[np.float64]
Columns = dict[str, Any]

UNITS = frozenset({
    "mm", "s", "min", "gwt", "kPa", "%", "MB", "bits", "1/mm", "cycles/mm", "impulses/s", "strain",
    "pseudo-units", "pseudo-units³", "1/pseudo-unit", "of the largest rate", "standard deviations", "1",
})  # fmt: skip
"""What brackets at the end of a label may hold; strain and 1 declare a number."""
COLOURS = {"black": "black", "gray": GREY, "blue": BLUE, "orange": ORANGE, "green": GREEN, "purple": PURPLE,
           "yellow": YELLOW, "white": "white"}  # fmt: skip
LEAST_POINTS = 6.5
LEAST_CONTRAST = 3.0
IMAGES = ("imshow", "pcolormesh", "contourf", "tricontourf")


# --- tables: columns that a series may show, found again from what the figures are drawn of ---


def _result(world: World, index: int, hold: int) -> Any:
    return next(one.result for one in world.found if (one.index, one.hold["hold"]) == (index, hold))


def _sample(world: World, index: int = -1, hold: int = 0, indices: Any = None, ends_s: Any = None) -> Columns:
    run = world.run
    if indices is not None:
        (condition,) = [one for one in conditions(run) if one.indices == indices]
        return vars(loading(condition, run))
    if ends_s is not None:
        readings = [s for s in run.stream("sample") if ends_s[0] <= s["t_s"] <= ends_s[1]]
    elif hold:
        parts = [list(part) for held, part in groupby(run.readings_of(index), lambda s: s["phase"] == "hold") if held]
        readings = parts[hold - 1]
    else:
        readings = [s for s in run.readings_of(index) if s["phase"] in ("press", "hold")]
    if not readings:
        return {}
    t, force = np.array([(s["t_s"], s["force_gwt"]) for s in readings]).T
    found = {"t_s": t, "force_gwt": force, "since touch_s": t - t[0], "in hold_s": t - t[0]}
    return found | ({"relative": force / force[0]} if hold else {})


def _hold_end(world: World, key: str = "", within: bool | None = None) -> Columns:
    """Of presses to 0.4 mm in two increments, with a tolerance of one step of the stage."""
    if not key:
        return {}
    ends = {index: holds[-1] for index, holds in list(world.run.done.items())[: world.presses]}
    found = np.array([(index, one[key], one["doi_sd_mm"]) for index, one in ends.items()])
    index, got, sd = found[[within in (None, abs(x - 0.4) <= 0.0025) for x in found[:, 1]]].T
    return {
        "index": index, "delivered": got, "difference": got - 0.4, "sd": sd,
        "ends of a line": np.ravel([index - 0.45, index + 0.45], "F"), "asked at its ends": [0.4] * (2 * len(index)),
        "edges": np.ravel([index - 0.5, index + 0.5], "F"), "tolerance at edges": np.full(2 * len(index), 0.0025),
    }  # fmt: skip


def _phases(world: World, phase: str) -> Columns:
    """Without seams, which would lighten the color."""
    ends: list[list[float]] = []
    for one in (one for one in spans(world.run) if one.what == phase and one.end_s > one.begin_s):
        if ends and ends[-1][1] == one.begin_s:
            ends[-1][1] = one.end_s
        else:
            ends.append([one.begin_s, one.end_s])
    begin, end = np.array(ends).reshape(-1, 2).T
    return {"begin_s": begin, "lasts_s": end - begin}


def _contact(world: World, index: int, hold: int, region: int) -> Columns:
    result = _result(world, index, hold)
    (x, pseudo), (low, high) = result.pressure_profile, result.contact_regions_mm[region - 1]
    at = np.r_[low, x[(x > low) & (x < high)], high]
    of_skin = dict(zip(("skin_x_mm", "skin_y_mm"), (np.interp(at, x, v) for v in result.skin_profile), strict=True))
    return {"undeformed_x_mm": at, "pressure_kpa": np.interp(at, x, pseudo * result.e_epidermis_mpa / 10), **of_skin}


def _indentor(world: World, index: int, hold: int) -> Columns:
    result = _result(world, index, hold)

    def height(x: Array) -> Array:
        h = result.indentor.evaluate((x - result.x_mm)[None]).height_mm
        return np.asarray(result.touch_height_mm - result.doi_mm + np.minimum(h, 1.3))

    return {"x_mm": np.copy, "height_mm": height}


def _from_below(world: World, number: int) -> Columns:
    result = world.found[number].result
    patch = result.model.patch
    x, _, z = patch.position_mm.T
    at = result.state.held.on(patch).interpolate(patch.position_mm.T)
    kpa = result.nodal_pressure_pseudo * result.e_epidermis_mpa / 10
    return {"x_mm": x, "z_mm": z, "pressure_kpa": kpa, "held_x_mm": at[0], "held_z_mm": at[2]}


def _measures(world: World, group: str = "", at: int = 0, **hold: int) -> Columns:
    found: dict[float, list[Any]] = {}
    for one in (one for one in world.found if one.group == group):
        found.setdefault(one.hold["x_mm"], []).append(one.result.receptor_measures)

    def means(measure: str) -> list[Any]:
        return [np.mean([shown(measure, one[measure])[at] for one in found[x]]) for x in sorted(found)]

    return {"x_mm": sorted(found), "mean -ep1": means("ep1"), "mean sed": means("sed")} if group else {}


def _spikes(world: World, of: str = "", row: int = 0, model: str = "", ends_s: Any = None) -> Columns:
    trains, presses = world.spikes.trains, pressed(world.run)
    if ends_s is not None:
        times = np.concatenate([one.spike_s for one in trains if len(one.spike_s)])
        return {"t_s": times[(times >= ends_s[0]) & (times <= ends_s[1])]}
    if model:
        mine = np.concatenate([one.spike_s for one in trains if one.model == model])
        number = sum(one.model == model for one in trains)
        before = max(one.hold_s - one.touch_s for one in presses) + 0.5
        bins = round((before + max(one.end_s - one.hold_s for one in presses) + 0.5) / 0.05)
        edges = 0.05 * np.arange(bins + 1) - before
        counts = np.sum([np.histogram(mine - one.hold_s, edges)[0] for one in presses], axis=0)
        return {"since hold_s": edges, "class rate": counts / (number * len(presses) * 0.05)}
    model, window = of.partition("\n")[0].split(", ")
    ends = [(p.touch_s, p.hold_s) if window == "press" else (p.hold_s, p.hold_end_s) for p in presses]
    x, places = np.array([round(p.x_mm, 3) for p in presses]), sorted({round(p.x_mm, 3) for p in presses})
    mine = [one.spike_s for one in trains if one.model == model]
    rates = np.array([[((times >= a) & (times < b)).sum() / (b - a) for a, b in ends] for times in mine])
    means = np.array([rates[:, x == place].mean(axis=1) for place in places]).T
    return {"x_mm": places, "rate": means[row], "mean rate": means.mean(axis=0)}


def _choices(world: World) -> Columns:
    found = [json.loads(one["probabilities"]) for one in world.run.stream("choice")]
    return {"number": range(len(found)), **{name: [one[name] for one in found] for name in LIKELY}}


def _stacked(world: World, stimulus: StimulusRow, receptor: int) -> Columns:
    found: Columns = {"x_mm": stimulus.x_mm}
    for name, values in zip(MEASURES, stimulus.measures, strict=True):
        mine, size = values[:, receptor], float(np.ptp(values)) or 1.0
        found[name] = (mine - (mine[0] + mine[-1]) / 2) / size + 0.8 * receptor
    return found


def _population(world: World, stimulus: StimulusRow, position: int | None = None) -> Columns:
    values = stimulus.measures if position is None else stimulus.measures[:, position]
    return vars(stimulus) | {"receptor_x_mm": stimulus.receptor_mm} | dict(zip(MEASURES, values, strict=True))


def _correlations(world: World, stimulus: StimulusRow) -> Columns:
    found = [one.r for one in world.comparison.overlays if one.stimulus is stimulus]
    return {"r": found[0] if found else np.full((len(MEASURES), len(stimulus.receptor_mm)), np.nan)}


def _shape_test(world: World, stimulus: StimulusRow) -> Columns:
    measure, receptor = np.nonzero(world.comparison.passes(stimulus))
    return {"measure": measure, "receptor": receptor}


def _pressure(world: World, stimulus: StimulusRow) -> Columns:
    ends = {"contact_end_mm": np.tile([-1.0, 1.0], len(stimulus.x_mm)), "at_x_mm": np.repeat(stimulus.x_mm, 2)}
    return {"skin_x_mm": stimulus.skin_mm, "x_mm": stimulus.x_mm, "pressure_kpa": stimulus.pressure, **ends}


def _strain(world: World, stimulus: StimulusRow, x: float) -> Columns:
    (one,) = [one for one in world.maps if one.stimulus.title == stimulus.title and one.x_mm == x]
    (corner_x, corner_y), (at_x, at_y) = np.moveaxis(one.corner_mm, -1, 0), one.receptor_mm.T
    corners = {"corner_x_mm": corner_x, "corner_y_mm": corner_y}
    return {**corners, "receptor_x_mm": at_x, "receptor_y_mm": at_y, **one.values}


def _of_stimulus(world: World, stimulus: int) -> NDArray[np.int64]:
    mine = np.flatnonzero(world.answer.places.stimulus == stimulus)
    return mine[np.argsort(world.answer.places.position_mm[mine])]


def _pairs(world: World, pair: str = "", stimulus: int | None = None) -> Columns:
    rows, places = world.answer.rows, world.answer.places
    names = list(dict.fromkeys(row.name for row in sorted(rows, key=lambda row: row.control)))
    receptors = sorted({row.receptor_mm for row in rows if row.receptor_mm is not None})
    if not pair:
        misfit = np.full((len(names), len(receptors)), np.nan)
        for row in rows:
            misfit[
                names.index(row.name), slice(None) if row.receptor_mm is None else receptors.index(row.receptor_mm)
            ] = row.lack_of_fit
        return {"misfit": misfit}
    row = next(row for row in rows if row.title == pair)

    def fit(eps: Array) -> Array:
        drive = np.maximum(row.k * (eps - row.eps0), 0.0)
        return np.asarray(drive / (1 + row.saturation * drive))

    mine = slice(None) if stimulus is None else _of_stimulus(world, stimulus)
    marks = [k for k, x in enumerate(receptors) if row.receptor_mm in (None, x)]
    return {
        "position_mm": places.position_mm[mine], "rate": places.rate[mine], "predicted": row.predicted[mine],
        "residual": row.residual[mine], "lack_of_fit": row.lack_of_fit, "receptor": marks,
        "line": [names.index(row.name)] * len(marks), "fit": fit,
        "eps": np.copy if stimulus is None else row.eps[mine],
    }  # fmt: skip


def _recorded(world: World, stimulus: int) -> Columns:
    mine, places = _of_stimulus(world, stimulus), world.answer.places
    return {"position_mm": places.position_mm[mine], "rate": places.rate[mine], "error": places.error[mine]}


def _left_out(world: World, stimulus: int) -> Columns:
    (one,) = [one for one in world.answer.left_out if one.stimulus == world.answer.stimuli[stimulus]]
    return {"position_mm": one.position_mm, "rate": 40 + 20 * np.cos(one.position_mm)}


def _joint_line(world: World, pair: tuple[int, int], stimulus: str = "") -> Columns:
    (joint,) = world.comparison.joints

    def line(x: Array) -> Array:
        overlay = next((one for one in joint.overlays if one.stimulus.title == stimulus), None)
        eps = x if overlay is None else overlay.stimulus.at(x)[pair[0], :, pair[1]]
        return np.asarray(np.maximum(0, joint.fit.k[pair] * (eps - joint.fit.eps0[pair])))

    return {"position_mm": np.copy, "eps": np.copy, "predicted": line, "rate": line}


def _recording(world: World, pair: tuple[int, int], stimulus: str) -> Columns:
    (one,) = [one for one in world.comparison.overlays if one.stimulus.title == stimulus]
    return _of_recording(one.recording) | {"eps": one.eps[pair[0], :, pair[1]]}


def _of_recording(found: Recording) -> Columns:
    return {"position_mm": found.position_mm, "rate": found.rate, "sd": found.sd}


def _deflection(world: World, simulated: int | None = None, measured: int | None = None) -> Columns:
    model, points = world.deflections
    return vars(points[measured] if simulated is None else model[simulated])


def _group(world: World) -> Columns:
    best = np.array([row.by_afferent for row in world.group.rows]).min(axis=0)
    return {"below the best": np.clip([row.by_afferent - best for row in world.group.rows], 0.5, 100.0).T}


def _bands(world: World, band: int) -> Columns:
    one = world.identified.bands[band]
    ends, middle = (one.width.low, one.width.high), one.width.middle
    return {
        "force_gwt": ends,
        "middle_gwt": middle,
        "measured_gwt": one.measured_gwt,
        "row": band,
        "rows": [band] * 2,
    }


def _presses(world: World, press: int, draw: int = 0) -> Columns:
    page = world.identified
    one, draws = page.measured[press], page.learned.draws[:60]
    t = one.trajectory.read_s - one.trajectory.t_s[0]
    return {"t_s": t, "force_gwt": one.force_gwt, "predicted_gwt": draws[draw, 0] * one.trajectory.read_s}


def _draws(which: str) -> Callable[[World], Columns]:
    def table(world: World) -> Columns:
        found = getattr(world.identified, which)
        estimates = {
            f"estimate of {name}": value for name, value in zip(found.prior.names, found.most_likely, strict=True)
        }
        return (
            dict(zip(found.prior.names, found.draws.T, strict=True)) | {"r": np.corrcoef(found.draws.T)} | estimates
        )

    return table


def _outcomes(world: World, design: str) -> Columns:
    mine = [world.design.at(design, minutes) for minutes in (5.0, 10.0)]
    shares = {kind: np.array([getattr(one, kind).mean() for one in mine]) for kind in ("failed", "kept")}
    smoothed = {kind: (6 * share + 1) / 8 for kind, share in shares.items()}
    errors = {f"{kind} sd": 100 * np.sqrt(p * (1 - p) / 6) for kind, p in smoothed.items()}
    return {"minutes": [5.0, 10.0], **{kind: 100 * share for kind, share in shares.items()}, **errors}


def _bench(world: World, line: tuple[str, str], family: str = "", quantity: str = "") -> Columns:
    def is_mine(row: dict[str, Any]) -> bool:
        return (
            (row["model"], row["element"]) == line
            and quantity in ("", row["quantity"])
            and family in ("", row["family"])
        )

    rows = [row for row in world.speed if is_mine(row)]
    found = {row["nodes"]: row for row in rows}
    return {key: [row[key] for row in found.values()] for key in ("nodes", "total_s", "memory_mb")} | {
        "error": [100 * max(row["error"] for row in rows if row["nodes"] == nodes) for nodes in found]
    }


def _example(world: World, phase: str, row: Any = None) -> Columns:
    recording = recorded(phase)

    def eps(x: Array) -> Array:
        names, values = world.rehearsal.at(x)
        receptor = int(np.argmin(np.abs(world.rehearsal.stimulus.receptor_mm - (row.receptor_mm or 0.0))))
        return np.asarray(values[names.index(row.name), :, receptor])

    def line(x: Array) -> Array:
        here = np.isfinite(eps(recording.position_mm))
        return predicted(fit_rates(eps(recording.position_mm)[here], recording.rate[here]), eps(x))

    return _of_recording(recording) | ({} if row is None else {"position_mm": np.copy, "predicted": line})


def _decoded(world: World) -> Columns:
    given = world.coding["decoded"]
    order, (lowest, highest) = np.argsort(given.receptor_mm), given.band
    of_receptors = {key: getattr(given, key)[order] for key in ("receptor_mm", "reading", "explained")}
    return given._asdict() | of_receptors | {"lowest": lowest, "highest": highest}


def _encoded(world: World) -> Columns:
    given = world.coding["encoding"]
    (true_mm, true_sed), place = given.true, given.operator.place_mm[:3]
    return {
        "place_mm": place, "normal": given.pressure[:3], "lateral": given.pressure[3:], "true_mm": true_mm,
        "receptor_mm": given.operator.receptor_mm, "sed": given.encoded.sed, "rate": given.encoded.rate,
        "true_sed": true_sed,
    }  # fmt: skip


def _impulse(world: World, axes: str) -> Columns:
    responses, errors = world.coding["impulse"][axes]
    frequency, amplitude = responses.spectra()
    found: Columns = {"place_mm": responses.sampling.place_mm, "load_mm": errors.place_mm, "frequency": frequency}
    for name, means, strain, size, error in zip(
        "hgf", ("e11", "e22", "e12"), responses.strain, amplitude, errors.strain, strict=True
    ):
        found |= {name: strain, f"spectrum of {name}": size / size.max(), f"error of {means}": 100 * error}
    return found | {"error of SED": 100 * errors.sed}


def _point_spread(world: World) -> Columns:
    judged = world.coding["point_spread"].judged
    x, _, z = judged.spread.sheet.skin_mm.T
    (load_x, _, load_z), laws = (
        judged.spread.load_mm,
        {"linear": judged.linear.at, "logarithmic": judged.logarithmic.at},
    )
    of_receptors = {"distance_mm": judged.spread.distance_mm, "sed": judged.spread.sed}
    return {"x_mm": x, "z_mm": z, "load_x": load_x, "load_z": load_z, "distance": np.copy, **of_receptors, **laws}


def _paths(world: World, path: str) -> Columns:
    _, paths, true = world.coding["search"]
    first, second = paths[path].T
    away = np.linalg.norm(paths[path] - true, axis=1)
    return {
        "first": first,
        "second": second,
        "move": np.arange(1, len(first) + 1),
        "away": np.where(away, away, np.nan),
    }


def _error_surface(world: World, surface: str) -> Columns:
    one = world.coding["search"][0][surface]
    decades = np.log10(np.maximum(one.error / one.error.max(), 10**-4.5))
    return {"first": one.first, "second": one.second, "decades": decades.T}


def _deformed(world: World) -> Columns:
    """The largest displacement is drawn as 0.5 mm; the mesh is closed."""
    at, moved = world.coding["point_spread"].deformed
    times = 0.5 / np.linalg.norm(moved, axis=-1).max()
    (skin_x, skin_y), (x, y) = (
        np.moveaxis(np.concatenate([one, one[:1]]), -1, 0) for one in (at, at + times * moved)
    )
    whole = {"x_mm": x, "y_mm": y, "x_mm across": x.T, "y_mm across": y.T}
    return whole | {"skin_x_mm": skin_x[:, 0], "skin_y_mm": skin_y[:, 0]}


def _sheet(world: World) -> Columns:
    given = world.coding["sheet"]
    x, z = given.receptor_mm.T
    return given._asdict() | {"standard deviation": given.sd, "receptor_x_mm": x, "receptor_z_mm": z}


TABLES: dict[str, Callable[..., Columns]] = {
    "sample.csv": _sample, "hold_end.csv": _hold_end, "phases": _phases, "model_contact.csv": _contact,
    "indentor": _indentor, "from below": _from_below, "model_measures.csv": _measures,
    "synthetic_spikes.csv": _spikes, "choice.csv": _choices, "stacked": _stacked, "population": _population,
    "correlations": _correlations, "shape test": _shape_test, "pressure": _pressure, "strain": _strain,
    "pairs": _pairs, "recorded": _recorded, "left out": _left_out, "joint line": _joint_line,
    "recording": _recording, "deflection": _deflection, "group": _group, "bands": _bands, "presses": _presses,
    "before": _draws("before"), "after": _draws("learned"), "outcomes": _outcomes, "bench": _bench,
    "not chosen": lambda world, shape: {"x_mm": [1.0], "target": [0.5]},
    "session": lambda world, shape: {"x_mm": [-1, 0], "target": [0.5, 1.0], "area": [128, 64], "number": [2, 2]},
    "confusion": lambda world: {"share": 100 * world.design.outcome.matrix},
    "steps": lambda world: {"presses": [0, 2, 3], "bits": [0.0, 0.5, 0.9]},
    "example": _example, "decoded": _decoded, "encoded": _encoded, "impulse": _impulse, "deformed": _deformed,
    "point spread": _point_spread, "paths": _paths, "error surface": _error_surface, "sheet": _sheet,
}  # fmt: skip
"""Columns of a table, of the rows that have some values; all other columns are those of the run's CSV files."""


def _file(run: Run, table: str, where: Any) -> list[dict[str, Any]]:
    name = table.removesuffix(".csv")
    rows: Sequence[dict[str, Any]] = run.stream(name)
    if not rows:
        with (run.folder.path / table).open(encoding="utf-8") as stream:
            rows = list(csv.DictReader(stream))
    return [row for row in rows if all(str(row[key]) == str(value) for key, value in where.items())]


def _claimed(world: World, one: Series, first: Array) -> list[Array]:
    """What the table has in the columns of a series; a column may be a function of the series' first."""
    assert one.rows is not None
    names = [column.removeprefix("-") for column in one.rows.columns]
    table = TABLES.get(one.rows.table, lambda world, **where: {})(world, **one.rows.where)
    if not all(name in table for name in names):
        rows = _file(world.run, one.rows.table, one.rows.where)
        table = {name: [row[name] for row in rows] for name in names}
    found = []
    for column, name in zip(one.rows.columns, names, strict=True):
        values = table[name](first) if callable(table[name]) else table[name]
        found.append((-1 if column != name else 1) * np.asarray(values, dtype=float))
    return found


def _stated(one: Series) -> list[Any]:
    """What a series draws, column by column."""
    if one.method == "broken_barh":
        return list(np.array(one.data[0]).reshape(-1, 2).T)
    return [np.concatenate(one.data[0])] if one.method == "eventplot" else list(one.data)


def _seen(columns: Sequence[Any], *, lines: bool) -> list[Array]:
    """Columns as (n,) each; of lines, which have gaps, only what is seen."""
    found = [np.ravel(np.asarray(column, dtype=float)) for column in columns]
    return list(np.stack(found)[:, np.isfinite(found).all(axis=0)]) if lines else found


# --- the walk ---


@dataclass(frozen=True)
class Walked:
    """A page that was made: its figures, what they are drawn of, and where in the sources they are made."""

    world: World
    figures: list[Plot]
    places: set[tuple[str, int]]


@pytest.fixture(scope="module")
def walk(
    bar_run: Run,
    finger: Fingertip,
    make_stimulus: Callable[..., StimulusRow],
    tmp_path_factory: pytest.TempPathFactory,
) -> Callable[[str], Walked]:
    known: dict[str, Walked] = {}
    folder = tmp_path_factory.mktemp("figures")

    def page(name: str) -> Walked:
        if name not in known:
            shown_: list[Plot] = []
            places: dict[int, tuple[str, int]] = {}
            init = Plot.__init__

            def noted(plot: Plot, *args: Any, **more: Any) -> None:
                init(plot, *args, **more)
                caller = sys._getframe(1)
                places.setdefault(id(plot.panels), (caller.f_code.co_filename, caller.f_lineno))

            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(page_parts, "as_svg", lambda plot: shown_.append(plot) or "")
                patch.setattr(Plot, "__init__", noted)
                made = FIGURES[name](folder / "page.html", bar_run, finger, make_stimulus)
            figures = [*shown_, *made.figures]
            known[name] = Walked(made.world, figures, {places[id(one.panels)] for one in figures})
        return known[name]

    return page


Walk = Callable[[str], Walked]
every_page = pytest.mark.parametrize("name", FIGURES)


def _series(plot: Plot) -> list[Series]:
    return [one for panel in plot.panels for one in panel.series]


def test_every_figure_is_on_a_page_of_the_walk(walk: Walk) -> None:
    """A figure is found where its Plot is made; a new one is on a page of the walk, or this is red."""
    seen = set().union(*(walk(name).places for name in FIGURES))
    for path in sorted(REPORT.glob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "Plot":
                lines = range(node.lineno, (node.end_lineno or node.lineno) + 1)
                assert any((str(path), line) in seen for line in lines), f"{path.name}:{node.lineno} is on no page"


@every_page
def test_every_series_is_the_table_that_it_claims_to_show(name: str, walk: Walk) -> None:
    page = walk(name)
    assert page.figures
    for plot in page.figures:
        for panel in plot.panels:
            assert any(one.rows for one in panel.series), f"{plot.title}: a panel of guides alone"
        for one in (one for one in _series(plot) if one.rows):
            lines = one.method not in (*IMAGES, "stairs")
            stated = _seen(_stated(one)[: len(one.rows.columns)], lines=lines)
            for got, table in zip(stated, _seen(_claimed(page.world, one, stated[0]), lines=lines), strict=True):
                about = f"{plot.title}: {one.rows}"
                np.testing.assert_allclose(got, table, rtol=2e-6, atol=1e-9, err_msg=about)


@every_page
def test_nothing_but_the_series_is_drawn(name: str, walk: Walk) -> None:
    """What finishes a figure adds texts, legends and scales; the limit of a trip is drawn where it is near."""
    for plot in (one for one in walk(name).figures if one.title != "Force against time"):
        stated = replace(plot, finish=lambda *_: None).draw(Figure(figsize=plot.size))
        for one, drawn in zip(stated, plot._drawn[1], strict=True):
            assert [*map(len, (one.lines, one.collections, one.images))] == [
                *map(len, (drawn.lines, drawn.collections, drawn.images))
            ], plot.title


@every_page
def test_every_axis_has_a_printed_label_with_its_unit(name: str, walk: Walk) -> None:
    for plot in walk(name).figures:
        figure, axes = plot._drawn
        printed = [one.get_text() for one in _texts(figure)]
        hyphens = [text for text in printed if re.search(r"(?<![\w.{])-[\d.]", text)]
        assert not hyphens, f"{plot.title}: a hyphen is no minus: {hyphens}"
        assert not [text for text in printed if "10^{0}" in text], f"{plot.title}: a power of ten for a number"
        for one, panel in zip(axes, plot.panels, strict=True):
            for text in filter(None, (panel.x, panel.y, panel.color)):
                unit = re.search(r"\(([^()]*)\)$", text.replace("\n", " "))
                assert unit, f"{plot.title}: {text!r} has no unit"
                assert unit[1] in UNITS, f"{plot.title}: {text!r} has no unit"
                assert text in printed, f"{plot.title}: {text!r} is not printed"
            for axis, label_, names in (("x", panel.x, panel.x_names), ("y", panel.y, panel.y_names)):
                ticks = [tick.get_text() for tick in getattr(one, f"get_{axis}ticklabels")() if tick.get_visible()]
                numbers = [text for text in ticks if re.match(r"−?[\d.$]", text)]
                assert label_ or names or not numbers, f"{plot.title}: axis {axis} of {panel.title!r} has no label"
                assert not (names and any(ticks)) or ticks == list(names), f"{plot.title}: {ticks} for {names}"


def _texts(figure: Figure) -> list[Any]:
    found: list[Any] = figure.findobj(Text)
    return [one for one in found if one.get_text().strip() and one.get_visible()]


@every_page
def test_nothing_lies_beyond_the_axes(name: str, walk: Walk) -> None:
    for plot in walk(name).figures:
        for axes, panel in zip(plot._drawn[1], plot.panels, strict=True):
            ends = {"x": sorted(axes.get_xlim()), "y": sorted(axes.get_ylim())}
            for axis, (low, high) in ends.items() if not panel.is_part else ():
                seen = [one for one in panel.series if one.method not in ("eventplot", "broken_barh", "fill_between")]
                values = np.concatenate([one.along(axis) for one in seen] or [np.zeros(0)])  # type: ignore[arg-type]
                cut = values[(values < low - 1e-6) | (values > high + 1e-6)]
                assert not len(cut), f"{plot.title}, {panel.title}: {axis} {cut} beyond {low} to {high}"
            rows = [one.get_lineoffset() for one in axes.collections if isinstance(one, EventCollection)]
            assert all(ends["y"][0] < row < ends["y"][1] for row in rows), f"{plot.title}: rows {rows} of {ends}"


@every_page
def test_a_caption_calls_color_a_position_only_if_a_scale_shows_it(name: str, walk: Walk) -> None:
    for plot in (one for one in walk(name).figures if re.search("[Cc]olor: position", one.caption)):
        assert "indentor x (mm)" in [one.get_text() for one in _texts(plot._drawn[0])], plot.title


@every_page
def test_the_alt_text_has_axes_and_ranges(name: str, walk: Walk) -> None:
    """The text is not the title, which stands above the figure, and has every label with the ends of its data."""
    for plot in walk(name).figures:
        assert not plot.title or plot.title not in plot.alt
        for panel in plot.panels:
            for text in filter(None, (panel.x, panel.y, panel.color)):
                assert " ".join(text.split()) in plot.alt
        assert re.search(r"−?[\d.]+ to −?[\d.]+|rows: \w+, \w+", plot.alt), plot.alt


@every_page
def test_colors_stand_out_on_a_dark_page(name: str, walk: Walk) -> None:
    """Every color has a contrast of 3 : 1 (WCAG 2.1, 1.4.11), or that which it has on paper, as grids and shades."""
    for plot in walk(name).figures:
        rules = dict(re.findall(r'\[style\*="(\w+: #\w{6})"\][^{]*\{\w+:(#\w{6})!', plot.page_svg))
        used = {"".join(found) for found in re.findall(r"((?:fill|stroke): )(#\w{6})", plot.svg)}
        assert used == set(rules)
        for color, on_page in rules.items():
            assert _contrast(on_page, PAPER) >= min(LEAST_CONTRAST, 0.99 * _contrast(color[-7:], "#ffffff")), color
        assert rules["fill: #ffffff"] == PAPER


@every_page
def test_marks_between_colored_dots_follow_the_page(name: str, walk: Walk) -> None:
    """A map hides the page, whose colors what lies on it must not follow; dots do not."""
    for plot in walk(name).figures:
        assert plot.svg
        for axes in plot._drawn[1]:
            if not axes.images and all(isinstance(one, PathCollection) for one in axes.collections):
                assert not any(line.get_gid() for line in axes.lines), plot.title


def _contrast(one: str, other: str) -> float:
    def luminance(color: str) -> float:
        srgb = np.array(to_rgb(color))
        linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
        return float(linear @ [0.2126, 0.7152, 0.0722])

    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


@every_page
def test_it_is_printed_at_its_own_size_and_can_be_read(name: str, walk: Walk) -> None:
    """An A4 page would shrink a larger figure, with its letters."""
    for plot in walk(name).figures:
        (width, height), figure = plot.size, plot._drawn[0]
        if plot.title:  # not a picture of a program
            assert (width <= PAGE_IN[0]) & (height <= PAGE_IN[1]), plot.title
        small = [one.get_text() for one in _texts(figure) if one.get_fontsize() < LEAST_POINTS]
        assert not small, f"{plot.title}: {small}"
        ink = figure.get_tightbbox()  # in inches
        assert min(ink.x0, ink.y0) >= 0, f"{plot.title} is cut off"
        assert (ink.x1 <= width) & (ink.y1 <= height), f"{plot.title} is cut off"


CLAIM = re.compile(
    r"\b(black|gray|blue|orange|green|purple|yellow|white)\b(?!: (?:nothing|no fit|lateral|zero))", re.I
)


def _colors(one: Series) -> Iterator[str]:
    for key in ("color", "colors", "mfc", "mec", "facecolor", "edgecolor", "edgecolors"):
        values = one.style.get(key, "none")
        yield from (
            to_hex(value) for value in (values if isinstance(values, list) else [values]) if str(value) != "none"
        )


@every_page
def test_the_caption_is_true(name: str, walk: Walk) -> None:
    """What it says of colors and marks is stated by a series."""
    for plot in walk(name).figures:
        series, caption = _series(plot), plot.caption.lower()
        there = {color for one in series for color in _colors(one)}
        for word in CLAIM.findall(plot.caption):
            assert to_hex(COLOURS[word.lower()]) in there, f"{plot.title}: {word}"
        said = {
            "dotted": any(one.style.get("ls") in (DOTTED, ":") for one in series),
            "dashed": any(one.style.get("ls") == "--" for one in series),
            "cross": any(one.style.get("marker") == "x" for one in series),
            "circles": any(one.style.get("marker") == "o" for one in series),
            "shaded": any(one.method in ("axhspan", "fill_between") for one in series),
            "hatched": any(one.style.get("hatch") for one in series),
        }
        for word, is_there in said.items():
            assert is_there or word not in caption, f"{plot.title}: nothing is {word}"
        thick = [one for one in series if float(one.style.get("lw", 1.0)) >= 4]
        assert all(one.style["solid_capstyle"] == "butt" for one in thick), "other ends would lengthen a region"


@every_page
def test_the_legend_is_of_what_is_drawn(name: str, walk: Walk) -> None:
    """All names are printed, and an entry without a series of its own looks like one."""
    for plot in walk(name).figures:
        printed = {one.get_text() for one in _texts(plot._drawn[0])}
        assert set(plot.names) <= printed, f"{plot.title}: {set(plot.names) - printed}"
        drawn = [(_look(one), set(_colors(one))) for one in _series(plot) if one.rows]
        for entry in plot.legend:
            look, colors = _look(entry), set(_colors(entry))
            alike = [found for looks, found in drawn if looks == look]
            is_there = any(colors & found or not found or not colors for found in alike)
            assert is_there or entry.name in MAY_BE_ABSENT, f"{plot.title}: nothing is drawn as {entry.name!r}"


def _look(one: Series) -> tuple[str, str]:
    """Dashes and marker, as matplotlib draws them; a mark of a raster is a short line."""
    if one.method == "errorbar":
        return "", str(one.style.get("fmt", one.style.get("marker")))
    return str(one.style.get("ls", "-")), str(one.style.get("marker", ""))


MAY_BE_ABSENT = ("in the set", "not rejected, but worse", "rejected by its fit", "start", "end", "true pressures")
"""Entries of a legend that is the same for every recording, or of guides."""


# --- what a table cannot say ---


def _plot(walk: Walk, page: str, title: str) -> Plot:
    return next(one for one in walk(page).figures if one.title.startswith(title))


def _showing(figures: Sequence[Plot], table: str, column: str = "") -> list[Series]:
    found = [one for plot in figures for one in _series(plot) if one.rows is not None and one.rows.table == table]
    return [one for one in found if one.rows is not None and (not column or column in one.rows.columns)]


def _xy(one: Series) -> Array:
    return np.array(np.broadcast_arrays(*one.data[:2]), dtype=float)


def _regions(world: World) -> int:
    first = {one.hold["x_mm"]: one for one in reversed(world.found) if one.last}
    return sum(len(one.result.contact_regions_mm) for one in first.values())


HOW_MANY: dict[tuple[str, str, str], Callable[[World], int]] = {
    ("run", "sample.csv", "since touch_s"): lambda world: len(world.run.done),
    ("run", "sample.csv", "in hold_s"): lambda world: sum(map(len, world.run.done.values())),
    ("run", "sample.csv", "mean_gwt"): lambda world: len(conditions(world.run)),
    ("run", "sample.csv", "sd_gwt"): lambda world: len(conditions(world.run)),
    ("run", "model_pressure.csv", "skin_x_mm"): lambda world: len(world.run.done),
    ("run", "model_pressure.csv", "pressure_kpa"): lambda world: len(world.run.done),
    ("run", "model_contact.csv", "skin_x_mm"): _regions,
    ("run", "model_contact.csv", "pressure_kpa"): _regions,
    ("run", "model_measures.csv", "receptor_x_mm"): lambda world: 2 * len(world.found),
    ("run of choices", "choice.csv", ""): lambda world: len(LIKELY),
    ("run with a relief", "from below", "pressure_kpa"): lambda world: len(world.found),
    ("comparison", "stacked", ""): lambda world: 3 * sum(len(one.receptor_mm) for one in world.comparison.stimuli),
    ("comparison", "population", "receptor_x_mm"): lambda world: 3 * len(world.comparison.stimuli),
    ("comparison", "correlations", ""): lambda world: len(world.comparison.stimuli),
    ("comparison", "pressure", "pressure_kpa"): lambda world: len(world.comparison.stimuli),
    ("comparison", "strain", "sed"): lambda world: len(world.maps),
    ("comparison", "pairs", "lack_of_fit"): lambda world: len(verdict_figures.ranking(world.answer)),
    ("comparison", "pairs", "line"): lambda world: sum(row.fits for row in world.answer.rows),
    ("comparison", "pairs", "residual"): lambda world: 3 * len(world.answer.stimuli),
    ("comparison", "pairs", "predicted"): lambda world: 3 * len(world.answer.stimuli),
    ("deflection", "deflection", ""): lambda world: sum(map(len, world.deflections)),
    ("identification", "presses", "force_gwt"): lambda world: len(world.identified.measured),
    ("identification", "presses", "predicted_gwt"): lambda world: 60 * len(world.identified.measured),
    ("identification", "bands", "force_gwt"): lambda world: len(world.identified.bands),
    ("design", "outcomes", ""): lambda world: 2 * len(world.design.names),
    ("benchmark", "bench", "error"): lambda world: 2 * 3 * 2 * 2,
}
"""Of how many different rows a page shows a column of a table, in one figure or several."""


@pytest.mark.parametrize("what", HOW_MANY, ids=lambda what: " ".join(what))
def test_all_rows_are_shown(what: tuple[str, str, str], walk: Walk) -> None:
    page, table, column = what
    rows = [one.rows for one in _showing(walk(page).figures, table, column) if one.rows is not None]
    different = {(one.columns, tuple(one.where.items())) for one in rows}
    assert len(different) == HOW_MANY[what](walk(page).world)


@pytest.mark.parametrize("name", ["run", "run resumed"])
def test_the_charts_to_zoom_into_have_all_readings(name: str, walk: Walk) -> None:
    run = walk(name).world.run
    charts = _plot(walk, name, "Force against time").charts
    assert len(charts) == (len(run.parts) or 1)
    shown_ = [(x, y) for one in charts for x, y in zip(one.x, one.lines[0].y, strict=True) if y is not None]
    t, force = np.array([(s["t_s"], s["force_gwt"]) for s in run.stream("sample")]).T
    np.testing.assert_allclose(np.array(shown_).T, [t.round(3), force.round(4)])
    assert all(np.all(np.diff(one.x) >= 0) for one in charts)  # as the library needs them


def test_a_day_between_the_parts_of_a_run_is_narrow_and_named(walk: Walk) -> None:
    """Both parts are as wide as their durations, and no line crosses the stop."""
    plot, run = _plot(walk, "run resumed", "Force against time"), walk("run resumed").world.run
    edges = np.array(run.parts).ravel()
    assert plot.panels[1].x.endswith("(s)")
    for t, _ in map(_xy, _showing([plot], "sample.csv")):
        assert not ((t[:-1] <= edges[1]) & (t[1:] >= edges[2])).any()
    for axes in plot._drawn[1]:
        at = axes.transData.transform(np.column_stack([edges, np.zeros(4)]))[:, 0]
        wide = np.diff(at) / (at[-1] - at[0])
        assert wide[2] / wide[0] == pytest.approx((edges[3] - edges[2]) / (edges[1] - edges[0]))
        assert 0.03 < wide[1] < 0.1
        ticks = np.array([tick for tick in axes.get_xticks() if edges[0] <= tick <= edges[3]])
        assert (ticks <= edges[1]).sum() >= 2
        assert (ticks >= edges[2]).sum() >= 2
        assert not ((ticks > edges[1]) & (ticks < edges[2])).any()
    assert "1 d" in {text.get_text() for text in _texts(plot._drawn[0])}
    assert sum(one.style.get("hatch") is not None for one in _series(plot)) == 2


def test_an_index_is_a_whole_number_even_where_there_is_one(walk: Walk) -> None:
    for axes in walk("run of one press").figures[0]._drawn[1]:
        low, high = axes.get_xlim()
        assert [tick for tick in axes.get_xticks() if low <= tick <= high] == [0]


def test_steps_of_readings_and_silence_are_not_magnified(walk: Walk) -> None:
    low, high = _plot(walk, "run", "Force against depth")._drawn[1][1].get_ylim()
    assert high - low >= 0.05
    low, high = walk("coding").figures[1]._drawn[1][2].get_ylim()
    assert low > -0.1 * high


@pytest.mark.parametrize("name", ["run", "run on a human finger"])
def test_an_indentor_is_drawn_to_the_same_height_on_both_sides(name: str, walk: Walk) -> None:
    for plot in (one for one in walk(name).figures if one.title.startswith("Contact, ")):
        for axes, panel in zip(plot._drawn[1][::2], plot.panels[::2], strict=True):
            (line,) = [one for one in panel.series if one.rows is not None and one.rows.table == "indentor"]
            x, y = _xy(line)[:, np.isfinite(_xy(line)[1])]
            left, right = axes.get_xlim()
            inside = [b for a, b in ((x[0], y[0]), (x[-1], y[-1])) if left + 1e-6 < a < right - 1e-6]
            assert inside == pytest.approx([y.min() + 1.3] * len(inside))


MEASURE_OF: dict[str, Callable[[Rows], str]] = {
    "stacked": lambda rows: rows.columns[1],
    "pairs": lambda rows: str(rows.where["pair"]).partition(" at ")[0],
    "joint line": lambda rows: MEASURES[rows.where["pair"][0]],  # type: ignore[index]
}


def test_a_measure_has_one_color_in_every_figure_of_a_comparison(walk: Walk) -> None:
    """A profile that does not pass the shape test is gray."""
    colors: dict[str, set[str]] = {}
    for table, measure_of in MEASURE_OF.items():
        for one in (one for one in _showing(walk("comparison").figures, table) if "color" in one.style):
            assert one.rows is not None
            colors.setdefault(measure_of(one.rows), set()).update(_colors(one))
    assert {"ep1", "sed"} <= colors.keys()
    for name, found in colors.items():
        assert found - {GREY} <= {to_hex(color_of(name))}, name


def test_a_step_up_is_as_large_as_the_title_says(walk: Walk) -> None:
    plot, stimulus = _plot(walk, "comparison", "SSRPs"), walk("comparison").world.comparison.stimuli[0]
    for panel in plot.panels:
        values = stimulus.measures[[label(one) for one in MEASURES].index(panel.title.partition(",")[0])]
        assert f"= {0.8 * (float(np.ptp(values)) or 1.0):.3g} " in panel.title


def test_positions_beside_a_receptor_are_those_of_its_correlation(walk: Walk) -> None:
    overlays = walk("comparison").world.comparison.overlays
    for panel, overlay in zip(_plot(walk, "comparison", "Correlation").panels, overlays, strict=True):
        used = np.isfinite(overlay.eps[0]).sum(axis=0)
        names = [f"{x:.2f} ({n})" for x, n in zip(overlay.stimulus.receptor_mm, used, strict=True)]
        assert list(panel.x_names) == [name.replace("-", "−") for name in names]


def test_numbers_on_a_map_are_its_values(walk: Walk) -> None:
    matrix = walk("design").world.design.outcome.matrix
    texts = _plot(walk, "design", "Expected confusion")._drawn[1][0].texts
    at = {(int(t.get_position()[1]), int(t.get_position()[0])): t.get_text().split()[0] for t in texts}
    assert at == {(i, j): f"{100 * matrix[i, j]:.0f}" for i, j in np.argwhere(matrix > 0).tolist()}
    group = walk("group").world.group
    plot = _plot(walk, "group", "Log-likelihood")
    assert list(plot.panels[0].x_names) == [row.name for row in group.rows]
    shares = [f"{100 * row.probability:.0f} %" for row in group.rows if row.in_set]
    assert [text.get_text() for text in plot._drawn[1][0].texts] == shares
    assert list(plot.panels[0].y_names) == list(group.afferents)
    design = _plot(walk, "design", "The design")
    assert [text.get_text() for text in design._drawn[1][0].texts] == ["2"]
    assert [panel.title for panel in design.panels] == ["1. bar:3.0: 3 presses"]
    low, high = design._drawn[1][0].get_ylim()
    assert low > high, "deeper is lower"


def test_the_force_band_of_an_identification_fits_a_phone(walk: Walk) -> None:
    """A window of 420 px, with a margin of 16 px on each side."""
    plot = _plot(walk, "identification", "The force band")
    assert 96 * plot.size[0] <= 420 - 2 * 16
    figure, (axes,) = plot._drawn
    assert all(text.get_window_extent().x1 <= figure.bbox.x1 for text in axes.texts)


def test_complete_knowledge_is_the_logarithm_of_the_candidates(walk: Walk) -> None:
    (dashed,) = [one for one in _series(_plot(walk, "design", "What each")) if one.style.get("ls") == "--"]
    assert dashed.data == (np.log2(3),)


def test_positions_left_out_are_crosses_as_many_as_the_sentence_says(walk: Walk) -> None:
    answer = walk("comparison").world.answer
    used, recorded_ = (int(n) for n in re.findall(r"\d+", positions(answer))[:2])
    crosses = _showing([_plot(walk, "comparison", "Verdicts")], "left out")
    assert sum(_xy(one).shape[1] for one in crosses) == recorded_ - used
    assert all(one.style["marker"] == "x" for one in crosses)


def test_the_ranking_is_in_order_with_the_marks_of_its_legend(walk: Walk) -> None:
    ranked = verdict_figures.ranking(walk("comparison").world.answer)
    marks = _showing([_plot(walk, "comparison", "Verdicts")], "pairs", "lack_of_fit")
    assert [one.data for one in marks] == [(row.lack_of_fit, height) for height, row in enumerate(ranked)]
    assert [one.style["marker"] for one in marks] == ["o" if row.fits else "x" for row in ranked]
    assert [one.style["mfc"] != "white" for one in marks] == [row.in_set for row in ranked]


def test_residuals_are_shaded_to_two_standard_deviations(walk: Walk) -> None:
    plot = _plot(walk, "comparison", "Residuals")
    bands = [one.data for panel in plot.panels for one in panel.series if one.method == "axhspan"]
    assert bands == [(-2.0, 2.0)] * len(plot.panels)


def test_five_candidates_have_colors_and_the_truth_is_dashed(walk: Walk) -> None:
    plot = _plot(walk, "run of choices", "Probabilities")
    lines = _showing([plot], "choice.csv")
    assert sum(one.style["color"] == GREY for one in lines) == 2
    assert [one.rows.columns[1] for one in lines if one.style["ls"] == "--"] == ["ep1"]  # type: ignore[union-attr]
    (legend,) = [one.get_legend() for one in plot._drawn[1]]
    assert [text.get_text() for text in legend.get_texts()] == [label(name) for name in LIKELY[:5]]


def test_densities_are_of_all_draws(walk: Walk) -> None:
    bars = [one for one in _series(_plot(walk, "identification", "Before")) if one.method == "hist"]
    assert len(bars) == 2 * 9
    for draws, edges in (one.data for one in bars):
        assert edges[0] - 1e-9 <= draws.min() <= draws.max() <= edges[-1] + 1e-9
    assert all(one.style["density"] for one in bars)


def test_a_rate_that_is_constant_has_all_figures_without_a_warning(make_stimulus: Callable[..., StimulusRow]) -> None:
    (constant,) = answers(made_comparison(make_stimulus, 0.0 * RATE + 20.0))
    figures = [one for section in answer_sections([constant], "", recorded=True) for one in section.figures]
    assert len(figures) > 3
    assert all(one.svg for one in figures)


def _crosses_a_gap(one: Series, gaps: Array) -> bool:
    points = _xy(one).T
    return any(
        np.isfinite([y, y_after]).all() and ((gaps >= x) & (gaps <= after)).any()
        for (x, y), (after, y_after) in pairwise(points)
    )


def test_a_line_stops_where_positions_are_left_out(walk: Walk) -> None:
    page = walk("comparison")
    gaps = np.array(sorted({x for one in page.world.answer.left_out for x in one.position_mm}))
    lines = _showing(page.figures, "pairs", "predicted")
    assert len(gaps)
    assert lines
    assert not any(_crosses_a_gap(one, gaps) for one in lines)
    sees = POSITIONS[
        np.abs(POSITIONS - 0.5) > 4
    ]  # one receptor, at −0.5 mm, which sees more than all of them together
    assert not any(_crosses_a_gap(one, sees) for one in _showing(page.figures, "joint line", "position_mm"))


def _without_a_position(answer: AfferentVerdict) -> tuple[AfferentVerdict, float]:
    """One stimulus leaves out its fourth position, between others."""
    places = answer.places
    gap = int(np.flatnonzero(places.stimulus == 0)[3])
    kept = np.arange(len(places.rate)) != gap
    rows = tuple(
        replace(row, eps=row.eps[kept], predicted=row.predicted[kept], residual=row.residual[kept])
        for row in answer.rows
    )
    x, rate = float(places.position_mm[gap]), float(places.rate[gap])
    left_out = (LeftOut(answer.stimuli[0], (x,), (rate,)),)
    return replace(answer, rows=rows, places=FittedPositions(*(one[kept] for one in places)), left_out=left_out), x


def test_the_gaps_are_inside_the_recording_too(walk: Walk) -> None:
    found, x = _without_a_position(walk("comparison").world.answer)
    for plot in (verdict_figures.the_answer(found, [0, 1], ""), verdict_figures.profiles(found, [0, 1], "")):
        first = Plot(plot.size, plot.panels[:1])
        assert [one.data[0] for one in _showing([first], "left out")] == [(x,)]
        lines = _showing([first], "pairs", "predicted")
        assert lines
        assert not any(_crosses_a_gap(one, np.array([x])) for one in lines)


@pytest.mark.parametrize("saturation", [0.0, 0.02])
def test_the_line_of_a_fit_is_the_fit_also_between_the_points(walk: Walk, saturation: float) -> None:
    """It has its corner where k(ε − ε₀) is zero, wherever the recorded positions lie."""
    answer = walk("comparison").world.answer
    rows = tuple(
        replace(row, k=10.0, eps0=float(np.mean(row.eps[:2])), saturation=saturation)
        for row in answer.rows
        if np.isfinite(row.eps).all() and np.ptp(row.eps) > 0
    )
    found = replace(answer, rows=rows)
    lines = _showing([verdict_figures.scatter(found, "")], "pairs", "fit")
    for line, row in zip(lines, verdict_figures.plotted_pairs(found), strict=True):
        eps, rate = _xy(line)
        drive = np.maximum(row.k * (eps - row.eps0), 0.0)
        np.testing.assert_allclose(rate, drive / (1 + saturation * drive))
        assert row.eps0 in eps
        assert len(eps) > 3 * len(np.unique(row.eps.round(9)))


# --- labels of all programs ---


def _written_labels() -> Iterator[tuple[str, str]]:
    """Every label of an axis that is written out for matplotlib in the sources, with its place."""
    for folder in ("rig", "sim", "studies", "examples"):
        for path, tree in trees_with(ROOT / folder, "label"):
            for node in ast.walk(tree):
                if isinstance(node, ast.Call):
                    given = [k.value for k in node.keywords if k.arg in ("xlabel", "ylabel")]
                    name = node.func.attr if isinstance(node.func, ast.Attribute) else ""
                    if name in ("set_xlabel", "set_ylabel", "supxlabel", "supylabel"):
                        given += node.args[:1]
                    for one in given:
                        if isinstance(one, ast.Constant) and isinstance(one.value, str) and one.value:
                            yield f"{path.relative_to(ROOT)}:{node.lineno}", one.value


def test_labels_in_the_sources_end_with_a_unit() -> None:
    found = list(_written_labels())
    assert len(found) > 10
    assert not [(place, text) for place, text in found if not re.search(r"\([^()]*\)$", text.replace("\n", " "))]


def test_controls_have_units() -> None:
    assert [verdict_figures.measured_in(name) for name in CONTROLS] == [
        "skin pressure (kPa)", "skin displacement (mm)", "indentor curvature (1/mm)", "half-space strain (1)",
    ]  # fmt: skip
