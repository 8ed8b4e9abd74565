"""Every figure of every page: what is drawn is the table behind it, and legend, caption and units are true of it."""

import ast
import inspect
import json
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import Collection, LineCollection, PathCollection, QuadMesh
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.text import Text
from numpy.typing import NDArray

from rig.compare.comparison import Comparison, compare
from rig.compare.group import GroupVerdict, group_verdict
from rig.compare.likelihood import Form
from rig.compare.make_verdict import afferents, answers, candidate_pool
from rig.compare.recordings.recording import recording
from rig.compare.stimuli import CONTROLS, StimulusMap, StimulusRow
from rig.compare.verdict import AfferentVerdict, FittedPositions, LeftOut
from rig.compare.verdict_text import positions
from rig.data import Run
from rig.data.tables import spans
from rig.design.choose import AddedPresses, ChosenPresses
from rig.design.confusion import Confusion, OrderedDesign
from rig.design.design import Design, DesignRequest
from rig.design.presses import PossiblePress
from rig.plan.config import load_config
from rig.plan.finger_model import PredictedHold, responses
from rig.report import (
    benchmark_page,
    coding_figures,
    design_page,
    group_page,
    identification_page,
    profile_figures,
    run_figures,
    verdict_figures,
)
from rig.report.choice_figure import choice_figures
from rig.report.comparison_report import shape_figures, shown_measures, simulation_figures
from rig.report.identification_page import ForceBand
from rig.report.measure_colors import color_of
from rig.report.page_parts import PageFigure, Section
from rig.report.recording_sections import Deflection, deflection_section, source_section
from rig.report.run_report import run_page_figures
from rig.report.run_tables import conditions, delivered, loading
from rig.report.style import BLUE, GREEN, GREY, ORANGE, PAGE_IN, PAPER, PURPLE, YELLOW, Plot, label
from rig.report.verdict_section import answer_sections
from sim.coding.encoding import Encoded
from sim.coding.point_spread import Judged, PointSpread, Sheet
from sim.coding.power_law import PowerLaw
from sim.coding.raju_table_6_1 import Deformed
from sim.coding.section import Sampling
from sim.identification.posterior import Learned
from sim.identification.predicted_forces import MeasuredPress, PressTrajectory
from sim.identification.prior import PARAMETERS, Prior
from sim.identification.uncertainty_bands import Width
from sim.measures.measures import MEASURES, shown
from sim.models.fingertip import Fingertip
from tests.sim.coarse_mesh import coarse_mesh
from tests.sources import trees_with

ROOT = Path(__file__).parents[3]
Array = NDArray[np.float64]

UNITS = frozenset({
    "mm", "s", "min", "gwt", "kPa", "%", "MB", "bits", "1/mm", "cycles/mm", "impulses/s", "strain",
    "pseudo-units", "pseudo-units³", "1/pseudo-unit", "unit of the recording", "standard deviations", "1",
})  # fmt: skip
"""What brackets at the end of a label may hold; strain and 1 declare a number."""
COLOURS = {"black": "black", "gray": GREY, "blue": BLUE, "orange": ORANGE, "green": GREEN, "purple": PURPLE,
           "yellow": YELLOW, "white": "white"}  # fmt: skip
DAY_S = 86400.0
LEAST_POINTS = 6.5
LEAST_GAP_PT = 1.2
"""Gaps of a dotted line that is seen as one."""


class World(NamedTuple):
    """What the figures are drawn of."""

    run: Run
    finger: Fingertip
    found: list[PredictedHold]
    human: list[PredictedHold]
    comparison: Comparison
    maps: list[StimulusMap]
    answer: AfferentVerdict
    identified: identification_page.IdentificationPage
    deflections: tuple[list[Deflection], list[Deflection]]
    speed: list[dict[str, Any]]
    coding: dict[str, Any]
    design: Design
    group: GroupVerdict


# --- worlds ---

X = np.linspace(-4.0, 4.0, 33)
RECEPTORS = np.array([-0.5, 0.0, 0.5])
POSITIONS = np.linspace(-4.25, 5.25, 20)
"""Recorded positions; the runs do not cover the first and the last of them at every receptor."""
RATE = 40.0 + 20.0 * np.cos(POSITIONS)


@pytest.fixture(scope="module")
def world(bar_run: Run, finger: Fingertip, make_stimulus: Callable[..., StimulusRow]) -> World:
    found = responses(bar_run, finger)
    comparison = _comparison(make_stimulus)
    (answer,) = answers(comparison)
    coarse = coarse_mesh(0.5, 1.0, patch_x_mm=4.0, patch_z_mm=2.5)
    config = load_config(ROOT / "examples" / "human_finger" / "finger.toml").finger
    human = Fingertip.load(config.model_copy(update={"mesh": coarse}))
    large = [replace(one, result=human.indent("bar:3.0", one.result.x_mm, doi_mm=0.4)) for one in found]
    return World(
        bar_run, finger, found, large, comparison, _maps(comparison), answer, _identified(), _deflections(), _speed(),
        _coding(), _design(), group_verdict(_judged(make_stimulus)),
    )  # fmt: skip


def _design() -> Design:
    """Two designs of three candidates at two durations; six experiments each, of which some fail."""
    candidates = ("ep1", "sed", "mean")

    def confusion(name: str, minutes: float, wrong: int) -> Confusion:
        truth = np.tile([0, 1, 2], 2)
        evidence = 9.0 * np.eye(3)[np.where(np.arange(6) < wrong, (truth + 1) % 3, truth)]
        return Confusion(name, minutes, 4, 3, candidates, truth, evidence, np.full(6, 8.0))

    steps = (AddedPresses((0, 1), 0.5), AddedPresses((2,), 0.9))
    outcomes = [confusion(name, t, n) for name, t, n in (
        ("designed", 5.0, 2), ("designed", 10.0, 1), ("random presses", 5.0, 4), ("random presses", 10.0, 3),
    )]  # fmt: skip
    of_no_figure: Any = None
    presses = [PossiblePress("bar:3.0", x, "doi_mm", depth) for x, depth in ((-1.0, 0.5), (0.0, 1.0), (1.0, 0.5))]
    table: Any = SimpleNamespace(presses=presses)
    made = OrderedDesign("designed", np.array([0, 1, 0]), np.arange(3.0), 10.0)
    return Design(
        DesignRequest(candidates, minutes=10.0), table, of_no_figure,
        ChosenPresses(np.array([1, 1, 1]), ("bar:3.0",), steps, 0.9, np.zeros(3)), (), made,
        tuple(outcomes), outcomes[0], 3, None, 1,
    )  # fmt: skip


def _comparison(make_stimulus: Callable[..., StimulusRow], rate: Array = RATE) -> Comparison:
    profile = 1.5 + np.cos(X[:, None] - RECEPTORS)
    both = np.sin(X[:, None] + RECEPTORS)
    made = [
        make_stimulus(shape, X, RECEPTORS, {"ep1": profile, "sed": profile**2, "ep3": both}, commanded=8.0)
        for shape in ("step:1", "step:3", "step:5")
    ]
    control = np.stack([profile[::-1], profile**3, both, profile + both])
    stimuli = [
        replace(one, controls=control, pressure=np.outer(np.arange(1.0, 34.0), np.ones(9)) * k)
        for k, one in enumerate(made, 1)
    ]
    rows = [(float(x), float(rate), 5.0) for x, rate in zip(POSITIONS, rate, strict=True)]
    return compare(stimuli, {shape: recording("made.csv", rows) for shape in ("step:1", "step:3", "step:5")})


def _judged(make_stimulus: Callable[..., StimulusRow]) -> dict[str, Any]:
    """Candidates and verdict of each of three afferents, whose rates differ a little."""
    found = {}
    for number in range(3):
        comparison = _comparison(make_stimulus, RATE + 5 * np.sin(np.arange(len(RATE)) + number))
        (overlays,), (verdict,) = afferents(comparison), answers(comparison)
        pool = candidate_pool(overlays, Form())
        assert pool is not None
        found[f"a{number}"] = pool, verdict
    return found


def _maps(comparison: Comparison) -> list[StimulusMap]:
    corners = np.stack(np.meshgrid(np.linspace(-9, 9, 7), np.linspace(8, 2, 4), indexing="ij"), axis=-1)
    values = np.linspace(0, 1, 18).reshape(6, 3)
    at = np.array([[0.0, 5.0], [1.0, 5.5]])
    return [
        StimulusMap(comparison.stimuli[0], x, corners, at, {"sed": values, "ep1": values}) for x in (-1.0, 0.0, 1.0)
    ]


def _identified() -> identification_page.IdentificationPage:
    prior, chance = Prior(PARAMETERS), np.random.default_rng(1)
    before, after = prior.draws(400, chance), prior.middle + 0.3 * prior.sd * chance.standard_normal((400, 9))
    after[0] = prior.bounds[1] + 0.1  # beyond all that was thought before
    none = np.zeros(0)
    learned = [
        Learned(prior, draws, prior.middle, none, none.astype(np.int64), 0.0, 400.0) for draws in (before, after)
    ]
    t = np.arange(5.0)
    presses = [
        MeasuredPress(PressTrajectory("bar:3.0", x, 2.0 + t, -0.1 * t, 2.5 + t), 2.0 + t, 0.01, 0.01)
        for x in (-1.2, 0.0)
    ]
    forces: Any = SimpleNamespace(forces_gwt=lambda draws, trajectory: np.outer(draws[:, 0], trajectory.read_s))
    bands = [
        ForceBand("press 1: bar:3.0 at −1.20 mm to 0.40 mm", Width(5.0, 4.5, 5.6), 5.2),
        ForceBand("bar:3.0 at 0.00 mm to 0.67 mm", Width(7.0, 6.6, 7.5)),
    ]
    return identification_page.IdentificationPage(
        forces, presses, learned[0], learned[1], [], [], [], [], bands, "2026-11-29 · run a (virtual bench)"
    )


def _deflections() -> tuple[list[Deflection], list[Deflection]]:
    z = np.linspace(2.0, 10.0, 30)
    model = [Deflection(doi, z, doi * np.exp(-((z - 6.0) ** 2))) for doi in (0.5, 1.0)]
    measured = [Deflection(0.5, z[::6], 0.4 + 0 * z[::6]), Deflection(float("nan"), z[::7], 0.2 + 0 * z[::7])]
    return model, measured


def _speed() -> list[dict[str, Any]]:
    return [
        {"model": model, "element": element, "refinement": f"{nodes}", "nodes": nodes, "scene": "s", "family": family,
         "quantity": quantity, "error": 0.1 / nodes**0.5 * (1 + k), "total_s": 1e-3 * nodes, "contact_s": 0.01,
         "memory_mb": nodes / 10}
        for model, element in (("finger", "bbar"), ("section", "bbar"))
        for nodes in (100, 1000)
        for family in ("smooth", "bar", "step")
        for k, quantity in enumerate(("force", "sed"))
    ]  # fmt: skip


def _coding() -> dict[str, Any]:
    place, receptor = np.array([-1.0, 0.0, 1.0]), np.array([2.0, -2.0, 0.0])
    operator = SimpleNamespace(
        place_mm=np.r_[place, place], receptor_mm=np.sort(receptor), name="influence", energy="finite"
    )
    encoded = Encoded(np.array([0.1, 0.5, 0.2]), np.array([0.0, 3.0, 0.0]), 0.0, 0.0)
    sampling = Sampling(half_length=4)
    n = len(sampling.place_mm)
    strain = np.array([np.cos(sampling.place_mm), -np.cos(sampling.place_mm) + 0.1, np.sin(sampling.place_mm)])
    spectra = np.arange(3.0), np.arange(1.0, 10.0).reshape(3, 3)
    impulse = SimpleNamespace(strain=strain, sampling=sampling, spectra=lambda: spectra)
    errors = SimpleNamespace(place_mm=sampling.place_mm, strain=np.abs(strain), sed=np.arange(float(n)) / 9)
    grid = np.stack(np.meshgrid(np.linspace(-2, 2, 5), [4.0], np.linspace(4, 8, 5), indexing="ij"), -1).reshape(-1, 3)
    spread = PointSpread(
        SimpleNamespace(number=3), np.array([0.1, 4.5, 6.2]), Sheet(grid, grid - [0, 0.7, 0]),
        np.linspace(1, 9, len(grid)), np.ones(len(grid)),
    )  # type: ignore[arg-type]  # fmt: skip
    nodes = np.stack(np.meshgrid(np.linspace(-2, 2, 5), np.linspace(4, 2, 3), indexing="ij"), -1)
    axis = np.linspace(0.0, 30.0, 7)
    path = np.array([[10.0, 10.0], [24.0, 10.0], [24.0, 11.0], [20.0, 14.0]])
    surface = coding_figures.ErrorSurface(axis, axis, (axis[:, None] - 20) ** 2 + (axis - 14) ** 2)
    return {
        "decoded": coding_figures.DecodingPlot(
            place, np.array([3.0, 5.0, 4.0]), (place + 1.5, place + 7), np.full(3, 4.0), receptor,
            np.array([1.0, 2.0, 3.0]), receptor**2,
        ),
        "encoding": coding_figures.EncodingPlot(
            operator, np.arange(6.0), encoded, (place, np.array([0.1, 0.4, 0.2])), receptor=True,  # type: ignore[arg-type]
        ),
        "impulse": {"skin": coding_figures.ImpulsePlot(impulse, errors)},  # type: ignore[arg-type]
        "spread": coding_figures.PointSpreadPlot(
            Deformed(nodes, 0.1 * np.ones_like(nodes)),
            Judged(spread, PowerLaw(3.0, 1.5, 0.9, 0.8), PowerLaw(4.0, 1.7, 0.9, 0.8)),
        ),
        "search": ({"valley": surface}, {"exact": path, "grid": path[:2]}, np.array([20.0, 14.0])),
        "sheet": coding_figures.SheetPlot(
            np.array([0.0, 1.0]), np.array([5.0, 6.0, 7.0]), np.arange(6.0).reshape(2, 3), np.ones((2, 3)),
            np.array([[0.5, 5.5]]),
        ),
    }  # fmt: skip


# --- what is drawn ---


def _axes(figure: Figure) -> list[Axes]:
    return [axes for axes in figure.axes if axes.get_visible() and axes.axison]


def _panels(figure: Figure) -> list[Axes]:
    return [axes for axes in _axes(figure) if not hasattr(axes, "_colorbar")]


def _data(line: Line2D) -> Array:
    """(n, 2) of what is seen."""
    found = np.array(np.broadcast_arrays(*line.get_data()), dtype=float).T
    return found[np.isfinite(found).all(axis=1)]


def _lines(axes: Axes, **style: object) -> list[Array]:
    """(2, n) of the lines of a style, as colour, marker or ls."""
    return [np.asarray(line.get_data(), dtype=float) for line in axes.lines if _is(line, **style)]


def _is(line: Line2D, colour: str | None = None, marker: str | None = None, ls: str | None = None) -> bool:
    shade = line.get_color() if line.get_linestyle() != "None" else line.get_markeredgecolor()
    return (
        (colour is None or to_hex(shade) == to_hex(colour))
        and (marker is None or line.get_marker() == marker)
        and (ls is None or line.get_linestyle() == ls)
    )


def _named(axes: Axes) -> dict[str, Array]:
    return {str(line.get_label()): np.asarray(line.get_data(), dtype=float) for line in axes.lines}


def _mesh(axes: Axes) -> Array:
    (mesh,) = [one for one in axes.collections if isinstance(one, QuadMesh)]
    return np.asarray(mesh.get_array(), dtype=float)


def _image(axes: Axes) -> Array:
    (image,) = [one for one in axes.get_children() if isinstance(one, AxesImage)]
    return np.ma.filled(np.ma.asarray(image.get_array(), dtype=float), np.nan)


Shown = Iterator[tuple[Any, Any]]


def _force_time(world: World, figure: Figure) -> Shown:
    above, below = _panels(figure)
    read = np.array([(s["t_s"], s["force_gwt"]) for s in world.run.stream("sample")]).T
    (drawn,) = [line for line in _lines(above, colour=BLUE, ls="-") if line.shape[1]]
    yield drawn[:, np.isfinite(drawn).all(axis=0)], read
    charts = run_figures.force_charts(world.run)
    yield len(charts), len(world.run.parts) or 1
    zoomed = [(x, y) for one in charts for x, y in zip(one.x, one.lines[0].y, strict=True) if y is not None]
    yield np.array(zoomed).T, np.stack([read[0].round(3), read[1].round(4)])
    yield all(np.all(np.diff(one.x) >= 0) for one in charts), True  # as the library needs them
    for what, colour in run_figures.PHASES.items():
        (bars,) = [one for one in below.collections if to_hex(one.get_facecolor()[0]).upper() == colour]  # type: ignore[index]
        widths = sum(float(np.ptp(path.vertices[:, 0])) for path in bars.get_paths())
        yield widths, sum(s.end_s - s.begin_s for s in spans(world.run) if s.what == what)
        edges = [path.vertices[:, 0] for path in bars.get_paths()]
        touching = sum(abs(a.max() - b.min()) < 1e-9 for a, b in pairwise(edges))
        yield touching, 0  # seams between bars would lighten the color


def _resumed(run: Run) -> Run:
    """The same run, stopped after half of its time and resumed a day later."""
    half_s = run.stream("sample")[len(run.stream("sample")) // 2]["t_s"]

    def later(t_s: float) -> float:
        return t_s + (DAY_S if t_s > half_s else 0.0)

    def moved(events: Any) -> Any:
        return {stream: [{**one, "t_s": later(one["t_s"])} for one in found] for stream, found in events.items()}

    parts = ((0.0, half_s), (half_s + DAY_S, run.end_s + DAY_S))
    return replace(
        run, events=moved(run.events), superseded=moved(run.superseded), end_s=run.end_s + DAY_S, parts=parts
    )


def _force_time_cut(world: World, figure: Figure) -> Shown:
    """Both parts are as wide as their durations, the day between them is narrow and labeled."""
    run = _resumed(world.run)
    yield from _force_time(world._replace(run=run), figure)
    above, below = _panels(figure)
    edges = np.array(run.parts).ravel()
    assert below.get_xlabel().endswith("(s)")
    for line in _lines(above, colour=BLUE, ls="-"):
        yield ((line[0, :-1] <= edges[1]) & (line[0, 1:] >= edges[2])).sum(), 0  # no line over the stop
    for axes in (above, below):
        at = axes.transData.transform(np.column_stack([edges, np.zeros(4)]))[:, 0]
        wide = np.diff(at) / (at[-1] - at[0])
        yield wide[2] / wide[0], (edges[3] - edges[2]) / (edges[1] - edges[0])
        yield 0.03 < wide[1] < 0.1, True
        ticks = [tick for tick in axes.get_xticks() if edges[0] <= tick <= edges[3]]
        yield all(edges[0] <= tick <= edges[1] or edges[2] <= tick <= edges[3] for tick in ticks), True
        yield sum(tick > edges[1] for tick in ticks) >= 2 and sum(tick < edges[2] for tick in ticks) >= 2, True
    yield {text.get_text() for text in above.texts} >= {"1 d"}, True
    hatched = [patch for axes in (above, below) for patch in axes.patches if patch.get_hatch()]
    yield len(hatched), 2


def _delivered(world: World, figure: Figure) -> Shown:
    above, below = _panels(figure)
    holds = {index: found[-1] for index, found in world.run.done.items()}
    asked = np.array([0.4 for _ in holds])  # in two increments, to a depth
    got = np.array([one["doi_mm"] for one in holds.values()])
    (lines,) = _lines(above, colour="black", ls="-")
    yield lines[1, ::3], asked
    drawn = np.sort(np.concatenate([line[1] for line in _lines(above, marker="o")]))
    yield drawn, np.sort(got)
    drawn = np.sort(np.concatenate([line[1] for line in _lines(below, marker="o")]))
    yield drawn, np.sort(got - asked)
    (tolerance,) = [one for one in below.collections if one.get_label() == "tolerance"]
    (band,) = [path.vertices for path in tolerance.get_paths()]
    yield (band[:, 1].min(), band[:, 1].max()), (-0.0025, 0.0025)  # a step of the stage


def _one_delivered(world: World, figure: Figure) -> Shown:
    """An index is a whole number, even where there is a single one."""
    (one,) = delivered(world.run)[:1]
    for axes in _panels(figure):
        low, high = axes.get_xlim()
        yield [tick for tick in axes.get_xticks() if low <= tick <= high], [one.index]


def _presses(world: World, figure: Figure) -> Shown:
    left, right = _panels(figure)
    wanted = []
    for condition in conditions(world.run):
        for index in condition.indices:
            pressed = [
                (s["t_s"], s["force_gwt"]) for s in world.run.readings_of(index) if s["phase"] in ("press", "hold")
            ]
            wanted.append(np.array(pressed).T - [[pressed[0][0]], [0]])
    for drawn, table in zip(_lines(left), wanted, strict=True):
        yield drawn, table
    for drawn in _lines(right):
        yield drawn[:, 0], (0.0, 1.0)


def _force_depth(world: World, figure: Figure) -> Shown:
    mean, sd = _panels(figure)
    found = [loading(condition, world.run) for condition in conditions(world.run)]
    for drawn, spread, one in zip(_lines(mean), _lines(sd), found, strict=True):
        assert one is not None
        yield drawn, (one.doi_mm, one.mean_gwt)
        yield spread, (one.doi_mm, one.sd_gwt)
    low, high = sd.get_ylim()
    yield high - low >= 0.05, True  # less would magnify the steps of the readings


def _last(found: Sequence[PredictedHold]) -> list[PredictedHold]:
    return sorted((one for one in found if one.last), key=lambda one: one.hold["x_mm"])


def _contact(world: World, figure: Figure, found: Sequence[PredictedHold] | None = None) -> Shown:
    above = [axes for axes in _panels(figure) if any(line.get_color() == "black" for line in axes.lines)]
    below = [axes for axes in _panels(figure) if axes not in above]
    last = _last(found or world.found)
    repeated = [[one for one in last if one.hold["x_mm"] == x] for x in sorted({one.hold["x_mm"] for one in last})]
    for skin, pressure, repeats in zip(above, below, repeated, strict=True):
        result = repeats[0].result
        yield _lines(skin, colour=GREY)[0], result.skin_profile
        x, pseudo = result.pressure_profile
        yield _lines(pressure, colour=BLUE)[0], (x, pseudo * result.e_epidermis_mpa / 10)
        filled = [one for one in pressure.collections if not isinstance(one, LineCollection)]
        ends = [path.vertices[:, 0] for one in filled for path in one.get_paths()]
        yield [(at.min(), at.max()) for at in ends], result.contact_regions_mm  # and nothing beyond the contact
        yield len(_lines(skin, colour=ORANGE)), len(result.contact_regions_mm)
        caps = {str(line.get_solid_capstyle()) for line in skin.lines if _is(line, colour=ORANGE)}
        yield caps, {"butt"}  # others would lengthen the region
        (indentor,) = _lines(skin, colour="black")
        lowest = result.touch_height_mm - result.doi_mm
        yield np.nanmin(indentor[1]), lowest
        ends = indentor[:, np.isfinite(indentor[1])][:, [0, -1]].T
        inside = [y for x, y in ends if skin.get_xlim()[0] + 1e-6 < x < skin.get_xlim()[1] - 1e-6]
        yield inside, [lowest + 1.3] * len(inside)  # both sides of a bar are drawn to the same height


def _contact_of_a_human(world: World, figure: Figure) -> Shown:
    return _contact(world, figure, world.human)


def _below(world: World, figure: Figure) -> Shown:
    for axes, one in zip(_panels(figure), _last(world.found), strict=True):
        yield _mesh(axes).ravel(), one.result.nodal_pressure_pseudo * one.result.e_epidermis_mpa / 10


def _population(world: World, figure: Figure) -> Shown:
    groups = sorted({one.group for one in world.found})  # a row each
    rows = [(group, measure) for group in groups for measure in ("ep1", "sed")]
    for axes, (group, measure) in zip(_panels(figure), rows, strict=True):
        chosen = [one for one in world.found if one.group == group]
        table = [shown(measure, one.result.receptor_measures[measure]) for one in chosen]
        yield sorted(line[1].tolist() for line in _lines(axes)), sorted(values.tolist() for values in table)
        yield _lines(axes)[0][0], chosen[0].result.model.receptors.position_mm[:, 0]


def _ssrps(world: World, figure: Figure) -> Shown:
    at = sorted({one.hold["x_mm"] for one in world.found})
    groups = list({one.group: 0 for one in world.found})
    for k, axes in enumerate(_panels(figure)):
        for group in groups:
            values = [
                np.mean([
                    shown("ep1", one.result.receptor_measures["ep1"])[k]
                    for one in world.found if one.group == group and one.hold["x_mm"] == x
                ]) for x in at
            ]  # fmt: skip
            yield _named(axes)[group], (at, values)


def _stacked(world: World, figure: Figure) -> Shown:
    stimulus = world.comparison.stimuli[0]
    for axes, measure in zip(_panels(figure), _measures(world), strict=True):
        values = stimulus.measures[MEASURES.index(measure)]
        size = float(np.ptp(values)) or 1.0
        profiles = _lines(axes, marker="o")
        steps = np.unique(np.round(np.diff(axes.get_yticks()), 9))
        yield f"{steps[0] * size:.3g}" in axes.get_title(), True
        for k, drawn in enumerate(profiles):
            ends = 0.5 * (values[0, k] + values[-1, k])
            yield drawn, (stimulus.x_mm, (values[:, k] - ends) / size + k * steps[0])
        caps = {str(line.get_solid_capstyle()) for line in axes.lines if line.get_linewidth() == 4}
        yield caps, {"butt"}


def _measures(world: World) -> list[str]:
    return shown_measures(world.comparison, [world.answer])


def _images(world: World, figure: Figure) -> Shown:
    for axes, measure in zip(_panels(figure), _measures(world), strict=True):
        yield _mesh(axes), world.comparison.stimuli[0].measures[MEASURES.index(measure)]


def _correlated(world: World, figure: Figure) -> Shown:
    for axes, overlay in zip(_panels(figure), world.comparison.overlays, strict=True):
        yield _image(axes), overlay.r
        used = np.isfinite(overlay.eps[0]).sum(axis=0)
        yield (
            [text.get_text() for text in axes.get_xticklabels()],
            [f"{x:.2f} ({n})".replace("-", "−") for x, n in zip(RECEPTORS, used, strict=True)],
        )


def _pressure_maps(world: World, figure: Figure) -> Shown:
    for axes, stimulus in zip(_panels(figure), world.comparison.stimuli, strict=True):
        yield _mesh(axes), stimulus.pressure
        (ends,) = _lines(axes, marker="|")
        yield ends, np.array([[end, x] for x in stimulus.x_mm for end in (-1.0, 1.0)]).T


def _strain_maps(world: World, figure: Figure) -> Shown:
    panels = _panels(figure)
    for axes, one in zip(panels, [*world.maps, *world.maps], strict=True):
        yield _mesh(axes).reshape(6, 3), one.values["sed"]
        (receptors,) = _lines(axes, marker="o")
        yield receptors.T, one.receptor_mm
        (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
        x, y = receptors
        yield bool((x > left).all() and (x < right).all() and (y > low).all() and (y < high).all()), True


def _rows_of(world: World) -> list[Any]:
    return verdict_figures.plotted_pairs(world.answer)


def _crosses(world: World, panels: Sequence[Axes], stimuli: Sequence[int]) -> Shown:
    """Positions left out are crosses at their recorded rates, as many as the sentence says."""
    answer = world.answer
    missing = {one.stimulus: one for one in answer.left_out}
    count = 0
    for axes, number in zip(panels, stimuli, strict=True):
        one = missing[answer.stimuli[number]]
        (crosses,) = _lines(axes, marker="x")
        yield crosses, (one.position_mm, one.rate)
        yield crosses[1], 40 + 20 * np.cos(crosses[0])
        count += crosses.shape[1]
    used, recorded = (int(n) for n in re.findall(r"\d+", positions(answer))[:2])
    yield count, recorded - used


def _recorded(world: World, axes: Axes, number: int) -> Shown:
    answer = world.answer
    mine = verdict_figures.of_stimulus(answer, number)
    (points,) = [one for one in axes.lines if _is(one, marker="o", ls="None")]
    yield np.asarray(points.get_data(), dtype=float), (answer.places.position_mm[mine], answer.places.rate[mine])
    (bars,) = [one for one in axes.collections if isinstance(one, LineCollection)]
    half = [np.ptp(segment[:, 1]) / 2 for segment in bars.get_segments()]
    yield half, answer.places.error[mine]


def _predicted(world: World, axes: Axes, number: int, row: Any, **style: object) -> Shown:
    mine = verdict_figures.of_stimulus(world.answer, number)
    (line,) = _lines(axes, **style)
    yield line[:, np.isfinite(line).all(axis=0)], (world.answer.places.position_mm[mine], row.predicted[mine])


def _the_answer(world: World, figure: Figure) -> Shown:
    *above, below = _panels(figure)
    numbers = range(len(world.answer.stimuli))
    yield from _crosses(world, above, numbers)
    for axes, number in zip(above, numbers, strict=True):
        yield from _recorded(world, axes, number)
        for row, style in zip(_rows_of(world), ("-", "--", ":"), strict=False):
            yield from _predicted(world, axes, number, row, colour=color_of(row.name), ls=style)
    ranked = verdict_figures.ranking(world.answer)
    drawn = [line for line in below.lines if len(line.get_xdata()) == 1]  # type: ignore[arg-type]
    yield [_data(line)[0, 0] for line in drawn], [row.lack_of_fit for row in ranked]
    yield [line.get_marker() == "o" for line in drawn], [row.fits for row in ranked]  # as the legend says


def _profiles(world: World, figure: Figure) -> Shown:
    rows, count = _rows_of(world), len(world.answer.stimuli)
    panels = _panels(figure)
    yield from _crosses(world, panels[:count], range(count))
    for k, axes in enumerate(panels):
        yield from _recorded(world, axes, k % count)
        row = rows[k // count]
        yield from _predicted(world, axes, k % count, row, colour=color_of(row.name), ls="-")


def _residuals(world: World, figure: Figure) -> Shown:
    rows, count, answer = _rows_of(world), len(world.answer.stimuli), world.answer
    for k, axes in enumerate(_panels(figure)):
        mine = verdict_figures.of_stimulus(answer, k % count)
        (points,) = _lines(axes, marker="o")
        yield points, (answer.places.position_mm[mine], rows[k // count].residual[mine])
        (shaded,) = axes.patches
        yield (shaded.get_y(), shaded.get_height()), (-2.0, 4.0)  # type: ignore[attr-defined]


def _scatter(world: World, figure: Figure) -> Shown:
    answer = world.answer
    for axes, row in zip(_panels(figure), _rows_of(world), strict=True):
        (eps, rate) = _lines(axes, colour=color_of(row.name), ls="-")[0]
        drive = np.maximum(row.k * (eps - row.eps0), 0.0)
        yield rate, drive / (1 + row.saturation * drive)
        points = np.concatenate([_data(line) for line in axes.lines if line.get_linestyle() == "None"])
        known = np.isfinite(row.eps)
        table = np.stack([row.eps, answer.places.rate], axis=1)[known]
        yield points[np.lexsort(points.T)], table[np.lexsort(table.T)]


def _every_pair(world: World, figure: Figure) -> Shown:
    (axes,) = _panels(figure)
    drawn, names = _image(axes), [text.get_text() for text in axes.get_yticklabels()]
    receptors = sorted({row.receptor_mm for row in world.answer.rows if row.receptor_mm is not None})
    for row in world.answer.rows:
        line = drawn[names.index(row.name if row.control else label(row.name))]
        value = line if row.receptor_mm is None else line[receptors.index(row.receptor_mm)]
        yield value, np.full_like(value, row.lack_of_fit)


def _source_scatter(world: World, figure: Figure) -> Shown:
    (joint,) = world.comparison.joints
    (line,) = _lines(_panels(figure)[0], colour=color_of("ep1"), ls="-")
    pair = MEASURES.index("ep1"), 0
    yield line[1], np.maximum(0, joint.fit.k[pair] * (line[0] - joint.fit.eps0[pair]))
    points = np.concatenate([_data(one) for one in _panels(figure)[0].lines if one.get_linestyle() == "None"])
    yield len(points), int(np.isfinite(joint.eps[pair[0], :, pair[1]]).sum())


def _source_profiles(world: World, figure: Figure) -> Shown:
    (joint,) = world.comparison.joints
    pair = MEASURES.index("ep1"), 0
    for axes, overlay in zip(_panels(figure), joint.overlays, strict=False):
        (line,) = _lines(axes, colour=color_of("ep1"), ls="-")
        eps = overlay.stimulus.at(line[0])[pair[0], :, pair[1]]
        yield line[1], np.maximum(0, joint.fit.k[pair] * (eps - joint.fit.eps0[pair]))


def _deflected(world: World, figure: Figure) -> Shown:
    (axes,) = _panels(figure)
    model, measured = world.deflections
    for drawn, one in zip([line for line in _lines(axes, ls="-") if line.shape[1] > 2], model, strict=True):
        yield drawn, (one.z_mm, one.deflection_mm)
    for drawn, one in zip(_lines(axes, marker="o"), measured, strict=True):
        yield drawn, (one.z_mm, one.deflection_mm)


def _force_band(world: World, figure: Figure) -> Shown:
    (axes,) = _panels(figure)
    bands = world.identified.bands
    spans = [line for line in _lines(axes, ls="-") if line.shape[1] == 2]
    yield [line[0] for line in spans], [(one.width.low, one.width.high) for one in bands]
    yield (
        [line[0, 0] for line in _lines(axes, marker="o")],
        [one.measured_gwt for one in bands if one.measured_gwt is not None],
    )


def _press_map(world: World, figure: Figure) -> Shown:
    (axes,) = _panels(figure)
    (points,) = [one for one in axes.collections if isinstance(one, PathCollection)]
    yield points.get_offsets(), [(-1.0, 0.5), (0.0, 1.0)]
    yield points.get_array(), [2.0, 2.0]  # the first and the third of the session, and the second
    yield [text.get_text() for text in axes.texts], ["2"]
    yield [axes.get_title()], ["1. bar:3.0: 3 presses"]
    (rest,) = _lines(axes, marker=".")
    yield rest.T, [(1.0, 0.5)]
    yield axes.get_ylim()[0] > axes.get_ylim()[1], True  # deeper is lower


def _log_likelihoods(world: World, figure: Figure) -> Shown:
    axes = _panels(figure)[0]
    rows = world.group.rows[: len(axes.get_xticklabels())]
    best = np.array([row.by_afferent for row in world.group.rows]).min(axis=0)
    yield _image(axes), np.clip([row.by_afferent - best for row in rows], 0.5, 100.0).T
    yield [tick.get_text() for tick in axes.get_xticklabels()], [row.name for row in rows]
    yield [tick.get_text() for tick in axes.get_yticklabels()], list(world.group.afferents)
    yield [text.get_text() for text in axes.texts], [f"{100 * r.probability:.0f} %" for r in rows if r.in_set]


def _over_time(world: World, figure: Figure) -> Shown:
    for axes, press in zip(_panels(figure), world.identified.measured, strict=True):
        t = press.trajectory.read_s - press.trajectory.t_s[0]
        yield _lines(axes, marker=".")[0], (t, press.force_gwt)
        forces = world.identified.predicted.forces_gwt(world.identified.learned.draws[:60], press.trajectory)
        yield [line[1] for line in _lines(axes, colour=BLUE)], forces


def _marginals(world: World, figure: Figure) -> Shown:
    page = world.identified
    for k, axes in enumerate(_panels(figure)):
        half = len(axes.patches) // 2
        for patches in (axes.patches[:half], axes.patches[half:]):
            area = sum(bar.get_width() * bar.get_height() for bar in patches)  # type: ignore[attr-defined]
            yield area, 1.0
        low, high = axes.patches[0].get_x(), axes.patches[half - 1].get_x() + axes.patches[0].get_width()  # type: ignore[attr-defined]
        for draws in (page.before.draws[:, k], page.learned.draws[:, k]):
            yield low - 1e-9 <= draws.min() <= draws.max() <= high + 1e-9, True
        yield _lines(axes, colour=ORANGE)[0][0], [page.learned.most_likely[k]] * 2


def _correlations(world: World, figure: Figure) -> Shown:
    yield _image(_panels(figure)[0]), np.corrcoef(world.identified.learned.draws.T)


def _pareto(world: World, figure: Figure) -> Shown:
    axes = _panels(figure)[0]
    rows = [
        row for row in world.speed if (row["family"], row["quantity"], row["model"]) == ("smooth", "force", "finger")
    ]
    yield _lines(axes, marker="o")[0], ([r["total_s"] for r in rows], [100 * r["error"] for r in rows])


def _cost(world: World, figure: Figure) -> Shown:
    for axes, key in zip(_panels(figure), ("total_s", "memory_mb"), strict=True):
        rows = {r["nodes"]: r[key] for r in world.speed if r["model"] == "finger"}
        yield _lines(axes, marker="o")[0], (list(rows), list(rows.values()))


def _failures(world: World, figure: Figure) -> Shown:
    failed, kept = _panels(figure)
    for one, other, name in zip(
        _lines(failed, marker="o"), _lines(kept, marker="o"), world.design.names, strict=True
    ):
        mine = [world.design.at(name, minutes) for minutes in (5.0, 10.0)]
        yield one, ([5.0, 10.0], [100 * m.failed.mean() for m in mine])
        yield other, ([5.0, 10.0], [100 * m.kept.mean() for m in mine])
    yield [text.get_text() for text in failed.get_legend().get_texts()], world.design.names


def _confusion(world: World, figure: Figure) -> Shown:
    axes = _panels(figure)[0]
    matrix = world.design.outcome.matrix
    yield _image(axes), 100 * matrix
    for ticks in (axes.get_xticklabels(), axes.get_yticklabels()):
        yield [tick.get_text() for tick in ticks], ["ep1", "sed", "mean"]
    shown = {(int(t.get_position()[1]), int(t.get_position()[0])): t.get_text().split()[0] for t in axes.texts}
    yield set(shown.items()), {((i, j), f"{100 * matrix[i, j]:.0f}") for i, j in np.argwhere(matrix > 0).tolist()}


def _growth(world: World, figure: Figure) -> Shown:
    axes = _panels(figure)[0]
    yield _lines(axes, marker="o")[0], ([0, 2, 3], [0.0, 0.5, 0.9])
    yield _lines(axes, ls="--")[0][1], [np.log2(3)] * 2


_LIKELY = ("sed", "ep1", "e22", "mean", "s22", "e11", "e12")
"""Candidates of an adaptive run, the most probable one first; the last two are grey."""


def _adaptive(run: Run) -> Run:
    """The same run, with choices: the probabilities part from one another with each of two counts."""
    events = []
    for number in range(3):
        weight = np.linspace(2.0, 1.0, len(_LIKELY)) ** number
        found = dict(zip(_LIKELY, (weight / weight.sum()).tolist(), strict=True))
        possible = None if number == 2 else number
        reason = "one_candidate" if possible is None else "same_shape"
        press = {"indentor": "bar:3.0", "x_mm": -0.4, "target": "doi_mm", "value": 0.4}
        choice = {"possible": possible, "reason": reason, "probabilities": json.dumps(found)}
        events.append({"t_s": run.start["t_s"], "index": number, **press, **choice})
    chooser = {"truth": {"candidate": "ep1"}, "source": "virtual:ep1", "possible_presses": 4}
    start = {**run.start, "choose": chooser}
    units = {**run.units, "choice": {}}
    return replace(run, start=start, events={**run.events, "choice": events}, units=units)


def _chosen(world: World, figure: Figure) -> Shown:
    axes = _panels(figure)[0]
    events = _adaptive(world.run).stream("choice")
    named = {name: line for name, line in _named(axes).items() if not name.startswith("_")}
    for name, line in named.items():
        measure = next(one for one in _LIKELY if label(one) == name)
        yield line, (range(3), [json.loads(event["probabilities"])[measure] for event in events])
    yield len(_lines(axes, marker="o", colour=GREY)), 2
    yield [text.get_text() for text in axes.get_legend().get_texts()], [label(name) for name in _LIKELY[:5]]
    (dashed,) = (line.get_label() for line in axes.lines if _is(line, marker="o", ls="--"))
    yield dashed == label("ep1"), True


def _decoded(world: World, figure: Figure) -> Shown:
    skin, energy = _panels(figure)
    given = world.coding["decoded"]
    yield _named(skin)["found"], (given.place_mm, given.pressure)
    yield _named(skin)["true"], (given.place_mm, given.true)
    order = np.argsort(given.receptor_mm)
    yield _named(energy)["readings"], (given.receptor_mm[order], given.reading[order])
    yield _named(energy)["explained"], (given.receptor_mm[order], given.explained[order])
    band = skin.collections[0].get_paths()[0].vertices
    for x, low, high in zip(given.place_mm, *given.band, strict=True):
        yield sorted({float(y) for at, y in band if at == x}), [low, high]


def _encoding(world: World, figure: Figure) -> Shown:
    skin, energy, rates = _panels(figure)
    given = world.coding["encoding"]
    yield _named(skin)["normal"], (given.operator.place_mm[:3], given.pressure[:3])
    yield _named(skin)["lateral"], (given.operator.place_mm[3:], given.pressure[3:])
    yield _named(energy)["influence"], (given.operator.receptor_mm, given.encoded.sed)
    yield _named(energy)["finite elements"], given.true
    yield _lines(rates)[0], (given.operator.receptor_mm, given.encoded.rate)
    yield rates.get_ylim()[0] > -0.1 * rates.get_ylim()[1], True


def _impulse(world: World, figure: Figure) -> Shown:
    response, spectrum, error = _panels(figure)
    ((responses_, errors),) = world.coding["impulse"].values()
    for name, values in zip(("h (e11)", "g (e22)", "f (e12)"), responses_.strain, strict=True):
        yield _named(response)[name], (responses_.sampling.place_mm, values)
    yield _named(response)["−g"][1], -responses_.strain[1]
    frequency, amplitude = responses_.spectra()
    yield _named(spectrum)["h"], (frequency, amplitude[0] / amplitude[0].max())
    yield _named(error)["SED"], (errors.place_mm, 100 * errors.sed)


def _point_spread(world: World, figure: Figure) -> Shown:
    _, over, fall = _panels(figure)
    judged = world.coding["spread"].judged
    yield _lines(over, marker="+")[0].ravel(), judged.spread.load_mm[[0, 2]]
    yield _named(fall)["receptors"], (judged.spread.distance_mm, judged.spread.sed)
    r, value = _lines(fall, colour=BLUE)[0]
    yield value, judged.linear.at(r)


def _search(world: World, figure: Figure) -> Shown:
    valley, left = _panels(figure)
    _, paths, true = world.coding["search"]
    for name, path in paths.items():
        yield _named(valley)[name], path.T
        away = np.linalg.norm(path - true, axis=1)
        yield _named(left)[name], (np.arange(1, len(path) + 1), np.where(away > 0, away, np.nan))


def _sheet(world: World, figure: Figure) -> Shown:
    given = world.coding["sheet"]
    for axes, values in zip(_panels(figure), (given.pressure, given.sd), strict=True):
        yield _mesh(axes), values


# --- the table ---


@dataclass(frozen=True)
class Row:
    """One figure: how it is made, what is shown in it, and whether panels cut off parts on purpose."""

    make: Callable[[World], PageFigure]
    shows: Callable[[World, Figure], Shown]
    cuts: bool = False


def _titled(begin: str, figures: Callable[[World], Sequence[PageFigure]]) -> Callable[[World], PageFigure]:
    return lambda world: next(figure for figure in figures(world) if figure.title.startswith(begin))


def _run(begin: str) -> Callable[[World], PageFigure]:
    return _titled(begin, lambda world: run_page_figures(world.run, world.found))


def _simulated(begin: str) -> Callable[[World], PageFigure]:
    def figures(world: World) -> list[PageFigure]:
        shown_ = _measures(world)
        return [
            *shape_figures(world.comparison, shown_), *simulation_figures(world.comparison, shown_, world.maps)
        ]  # fmt: skip

    return _titled(begin, figures)


def _sections(sections: Callable[[World], Sequence[Section]]) -> Callable[[World], list[PageFigure]]:
    return lambda world: [figure for section in sections(world) for figure in section.figures]


def _said(begin: str) -> Callable[[World], PageFigure]:
    return _titled(begin, _sections(lambda world: answer_sections([world.answer], "no offset", recorded=True)))


def _source(begin: str) -> Callable[[World], PageFigure]:
    return _titled(begin, _sections(lambda world: [source_section(world.comparison)]))


def _bare(plot: Callable[[World], Plot]) -> Callable[[World], PageFigure]:
    return lambda world: PageFigure("", plot(world), "")


def _identification(begin: str) -> Callable[[World], PageFigure]:
    return _titled(begin, lambda world: identification_page.identification_figures(world.identified))


def _few(world: World) -> PageFigure:
    one = world.comparison.stimuli[0]
    few = replace(one, x_mm=X[:5], measures=one.measures[:, :5])
    return PageFigure("", profile_figures.populations(few, ["ep1"]), "")


def _few_lines(world: World, figure: Figure) -> Shown:
    (axes,) = _panels(figure)
    values = world.comparison.stimuli[0].measures[MEASURES.index("ep1")]
    yield np.array([line[1] for line in _lines(axes)]), values[:5]


def _one_receptor(world: World) -> PageFigure:
    """Of both signs, so that zero would get a contour, which a row of one receptor cannot have."""
    one = world.comparison.stimuli[0]
    alone = replace(one, measures=one.measures[:, :, :1], receptor_mm=one.receptor_mm[:1])
    return PageFigure("", profile_figures.populations(alone, ["ep3"]), "")


def _one_column(world: World, figure: Figure) -> Shown:
    values = world.comparison.stimuli[0].measures[MEASURES.index("ep3")][:, :1]
    assert values.min() < 0 < values.max()
    yield _mesh(_panels(figure)[0]), values


FIGURES: dict[str, Row] = {
    "run_figures.force_time": Row(_run("Force against time"), _force_time),
    "run_figures.force_time, resumed": Row(
        _titled("Force against time", lambda world: run_page_figures(_resumed(world.run), [])), _force_time_cut
    ),
    "run_figures.delivered_presses": Row(_run("Delivered"), _delivered),
    "run_figures.delivered_presses, one": Row(
        _bare(lambda w: run_figures.delivered_presses(delivered(w.run)[:1])), _one_delivered
    ),
    "run_figures.presses": Row(_run("Press, hold"), _presses),
    "run_figures.force_depth": Row(_run("Force against depth"), _force_depth),
    "run_figures.contact_panels": Row(_run("Contact, "), _contact),
    "run_figures.contact_panels, human": Row(
        _titled("Contact, ", lambda world: run_page_figures(world.run, world.human)),
        _contact_of_a_human,
    ),
    "run_figures.contacts_from_below": Row(
        _bare(lambda world: run_figures.contacts_from_below([r.result for r in _last(world.found)], ["x"] * 6)),
        _below, cuts=True,
    ),
    "run_figures.population_responses": Row(_run("Population"), _population),
    "run_figures.ssrps": Row(_run("SSRP of ep1"), _ssrps),
    "profile_figures.ssrps": Row(_simulated("SSRPs"), _stacked),
    "profile_figures.populations": Row(_simulated("Population"), _images),
    "profile_figures.populations, few": Row(_few, _few_lines),
    "profile_figures.populations, one receptor": Row(_one_receptor, _one_column),
    "profile_figures.correlations": Row(_simulated("Correlation"), _correlated),
    "profile_figures.pressure_maps": Row(_simulated("Pressure"), _pressure_maps),
    "profile_figures.strain_maps": Row(_simulated("Strain under"), _strain_maps, cuts=True),
    "verdict_figures.the_answer": Row(_said("Verdicts"), _the_answer),
    "verdict_figures.profiles": Row(_said("Recorded over"), _profiles),
    "verdict_figures.residuals": Row(_said("Residuals"), _residuals),
    "verdict_figures.scatter": Row(_said("Rate against"), _scatter),
    "verdict_figures.every_pair": Row(_said("Every pair"), _every_pair),
    "recording_sections.scatter": Row(_source("Fig. 5-8"), _source_scatter),
    "recording_sections.overlays": Row(_source("Fig. 5-9"), _source_profiles),
    "recording_sections.deflections": Row(
        _titled("Deflection", _sections(lambda world: [deflection_section(*world.deflections)])), _deflected
    ),
    "identification_page.presses_over_time": Row(_identification("Each press"), _over_time),
    "identification_page.marginals": Row(_identification("Before"), _marginals),
    "identification_page.correlations": Row(_identification("Correlations"), _correlations),
    "identification_page.force_band": Row(
        _bare(lambda w: identification_page.force_band(w.identified.bands)), _force_band
    ),
    "design_page.press_map": Row(_bare(lambda w: design_page.press_map(w.design)), _press_map),
    "design_page.curves": Row(_bare(lambda w: design_page.curves(w.design)), _failures),
    "design_page.confusion": Row(_bare(lambda w: design_page.confusion(w.design.outcome)), _confusion),
    "group_page.log_likelihoods": Row(_bare(lambda w: group_page.log_likelihoods(w.group)), _log_likelihoods),
    "choice_figure.probabilities": Row(
        _titled("Probabilities", lambda w: choice_figures(_adaptive(w.run))), _chosen
    ),
    "design_page.growth": Row(_bare(lambda w: design_page.growth(w.design)), _growth),
    "benchmark_page.pareto": Row(_titled("Error against time", lambda w: benchmark_page.figures(w.speed)), _pareto),
    "benchmark_page.cost_against_nodes": Row(_titled("Cost", lambda w: benchmark_page.figures(w.speed)), _cost),
    "coding_figures.decoded_figure": Row(
        _bare(lambda w: coding_figures.decoded_figure(w.coding["decoded"])), _decoded
    ),
    "coding_figures.encoding_figure": Row(
        _bare(lambda w: coding_figures.encoding_figure(w.coding["encoding"])), _encoding
    ),
    "coding_figures.impulse_figure": Row(
        _bare(lambda w: coding_figures.impulse_figure(w.coding["impulse"])), _impulse
    ),
    "coding_figures.point_spread_figure": Row(
        _bare(lambda w: coding_figures.point_spread_figure(w.coding["spread"])), _point_spread
    ),
    "coding_figures.search_figure": Row(
        _bare(lambda w: coding_figures.search_figure(*w.coding["search"])), _search
    ),
    "coding_figures.sheet_figure": Row(_bare(lambda w: coding_figures.sheet_figure(w.coding["sheet"])), _sheet),
}  # fmt: skip


def test_the_table_has_every_figure() -> None:
    made = {
        f"{name}.{function.__name__}"
        for name in sorted(path.stem for path in (ROOT / "rig" / "report").glob("*.py"))
        for function in vars(import_module(f"rig.report.{name}")).values()
        if inspect.isfunction(function)
        and function.__module__ == f"rig.report.{name}"
        and not function.__name__.startswith("_")
        and inspect.signature(function).return_annotation is Plot
    }
    assert made == {name.partition(",")[0] for name in FIGURES}


@pytest.fixture(scope="module")
def drawn(world: World) -> Callable[[str], tuple[PageFigure, Figure]]:
    known: dict[str, tuple[PageFigure, Figure]] = {}

    def once(name: str) -> tuple[PageFigure, Figure]:
        if name not in known:
            page = FIGURES[name].make(world)
            figure = page.plot._laid_out
            figure.draw_without_rendering()
            known[name] = page, figure
        return known[name]

    return once


Drawn = Callable[[str], tuple[PageFigure, Figure]]


@pytest.mark.parametrize("name", FIGURES)
def test_it_shows_its_table(name: str, world: World, drawn: Drawn) -> None:
    pairs = list(FIGURES[name].shows(world, drawn(name)[1]))
    assert pairs
    for got, table in pairs:
        if isinstance(got, bool | set) or (isinstance(got, list) and isinstance(got[0], str | bool)):
            assert got == table
        else:
            np.testing.assert_allclose(np.asarray(got, dtype=float), np.asarray(table, dtype=float), atol=1e-9)


def test_a_rate_that_is_constant_has_all_figures_without_a_warning(make_stimulus: Callable[..., StimulusRow]) -> None:
    (constant,) = answers(_comparison(make_stimulus, 0.0 * RATE + 20.0))
    sections = answer_sections([constant], "no offset", recorded=True)
    assert sum(len(one.figures) for one in sections) > 3
    for section in sections:
        for figure in section.figures:
            canvas = Figure(figsize=figure.plot.size, layout=figure.plot.layout)
            figure.plot.draw(canvas)
            canvas.draw_without_rendering()


@pytest.mark.parametrize("name", FIGURES)
def test_every_label_has_its_unit(name: str, drawn: Drawn) -> None:
    _, figure = drawn(name)
    written = [text for text in _labels(figure) if text]
    assert written
    shown_ = [text.get_text() for text in figure.findobj(Text) if text.get_visible()]  # type: ignore[attr-defined]
    assert not [text for text in shown_ if re.search(r"(?<![\w.{])-[\d.]", text)], "a hyphen is no minus"
    for text in written:
        found = re.search(r"\(([^()]*)\)$", text.replace("\n", " "))
        assert found, f"{text!r} has no unit"
        assert found[1] in UNITS, text
    for axes in _panels(figure):
        for which in ("x", "y"):
            ticks = [tick for tick in getattr(axes, f"get_{which}ticklabels")() if tick.get_text()]
            if ticks and getattr(axes, f"{which}axis").get_visible() and _numbers(ticks):
                assert _label_of(figure, axes, which), f"axis {which} of {axes.get_title()!r} has no label"


def _numbers(ticks: Sequence[Any]) -> bool:
    return any(re.match(r"−?[\d.$]", tick.get_text()) for tick in ticks if tick.get_visible())


def _labels(figure: Figure) -> Iterator[str]:
    for axes in _axes(figure):
        yield from (axes.get_xlabel(), axes.get_ylabel())
        mappable = getattr(getattr(axes, "_colorbar", None), "mappable", None)
        if mappable is not None and not (axes.get_xlabel() or axes.get_ylabel()):
            yield mappable.axes.get_title()  # a scale without a label is that of its panel
    for part in (figure, *figure.subfigs):
        yield from (text.get_text() for text in (part._supxlabel, part._supylabel) if text is not None)  # type: ignore[attr-defined]
        yield from (text.get_text() for text in part.texts if text.get_text().endswith(")"))


def _label_of(figure: Figure, axes: Axes, which: str) -> str:
    """Label of an axis: its own, that of its row or column, or that of the figure."""
    edge = {"x": "x0", "y": "y0"}[which]
    beside = [
        one for one in _panels(figure)
        if abs(getattr(one.get_position(), edge) - getattr(axes.get_position(), edge)) < 0.02
    ]  # fmt: skip
    own = [getattr(one, f"get_{which}label")() for one in beside]
    part: Any = axes.figure
    whole = getattr(part, f"_sup{which}label")
    loose = [text.get_text() for text in figure.texts if (text.get_rotation() == 90) == (which == "y")]
    return "".join([*own, whole.get_text() if whole else "", *loose])


@pytest.mark.parametrize("name", [name for name, row in FIGURES.items() if not row.cuts])
def test_nothing_lies_beyond_the_axes(name: str, drawn: Drawn) -> None:
    for axes in _panels(drawn(name)[1]):
        (left, right), (low, high) = (sorted(lim) for lim in (axes.get_xlim(), axes.get_ylim()))
        points = [_data(line) for line in axes.lines if line.get_transform() == axes.transData]
        points += [np.asarray(one.get_offsets()) for one in axes.collections if isinstance(one, PathCollection)]
        points += [
            np.asarray(one.get_coordinates(), dtype=float).reshape(-1, 2)
            for one in axes.collections if isinstance(one, QuadMesh)
        ]  # fmt: skip
        for x, y in (point.T for point in points):
            assert ((x >= left - 1e-6) & (x <= right + 1e-6)).all(), (axes.get_title(), left, right, x)
            assert ((y >= low - 1e-6) & (y <= high + 1e-6)).all(), (axes.get_title(), low, high, y)


@pytest.mark.parametrize("name", FIGURES)
def test_its_alt_text_has_axes_and_ranges(name: str, drawn: Drawn) -> None:
    """The text is not the title, which stands above the figure, and has every label with the ends of its axis."""
    page, figure = drawn(name)
    assert page.title not in page.alt or not page.title
    for axes in _panels(figure):
        for text in filter(None, (axes.get_xlabel(), axes.get_ylabel())):
            assert " ".join(text.split()) in page.alt
    assert re.search(r"−?[\d.]+ to −?[\d.]+|rows: \w+, \w+", page.alt)


@pytest.mark.parametrize("name", FIGURES)
def test_its_colors_stand_out_on_a_dark_page(name: str, drawn: Drawn) -> None:
    """Every color has a contrast of 3 : 1 (WCAG 2.1, 1.4.11), or that which it has on paper, as grids and shades."""
    plot = drawn(name)[0].plot
    rules = dict(re.findall(r'\[style\*="(\w+: #\w{6})"\][^{]*\{\w+:(#\w{6})!', plot.page_svg))
    used = {"".join(found) for found in re.findall(r"((?:fill|stroke): )(#\w{6})", plot.svg)}
    assert used == set(rules)
    for color, shown_ in rules.items():
        assert _contrast(shown_, PAPER) >= min(LEAST_CONTRAST, 0.99 * _contrast(color[-7:], "#ffffff")), color
    assert rules["fill: #ffffff"] == PAPER


LEAST_CONTRAST = 3.0


def _contrast(one: str, other: str) -> float:
    def luminance(color: str) -> float:
        srgb = np.array(to_rgb(color))
        linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
        return float(linear @ [0.2126, 0.7152, 0.0722])

    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


PROFILES = ("verdict_figures.the_answer", "verdict_figures.profiles", "verdict_figures.residuals",
            "recording_sections.overlays")  # fmt: skip


@pytest.mark.parametrize("name", PROFILES)
def test_a_line_stops_where_positions_are_left_out(name: str, world: World, drawn: Drawn) -> None:
    """And no point of a profile is at zero there: a cross is at the recorded rate."""
    gaps = np.array(sorted({x for one in world.answer.left_out for x in one.position_mm}))
    if name.startswith("recording"):  # one receptor, at −0.5 mm, which sees more than all of them together
        gaps = POSITIONS[np.abs(POSITIONS - 0.5) > 4]
    assert len(gaps)
    for axes in _panels(drawn(name)[1]):
        for line in axes.lines:
            points = np.array(np.broadcast_arrays(*line.get_data()), dtype=float).T
            if line.get_linestyle() == "None":
                for x, y in points[np.isin(points[:, 0], gaps)]:
                    assert y == pytest.approx(40 + 20 * np.cos(x)), (name, x)
            elif points[0, 0] != 0:
                for (x, y), (after, y_after) in pairwise(points):
                    crossed = np.isfinite([y, y_after]).all() and ((gaps >= x) & (gaps <= after)).any()
                    assert not crossed, (name, x, after)


def _drawn_alone(plot: Plot) -> list[Axes]:
    figure = Figure(figsize=plot.size, layout=plot.layout)
    plot.draw(figure)
    figure.draw_without_rendering()
    return [axes for axes in figure.axes if axes.lines]


def test_the_gaps_are_inside_the_recording_too(world: World) -> None:
    """As where one stimulus leaves out a position between others."""
    places, title = world.answer.places, world.answer.stimuli[0]
    gap = int(np.flatnonzero(places.stimulus == 0)[3])
    kept = np.arange(len(places.rate)) != gap
    rows = tuple(
        replace(row, eps=row.eps[kept], predicted=row.predicted[kept], residual=row.residual[kept])
        for row in world.answer.rows
    )
    x, rate = float(places.position_mm[gap]), float(places.rate[gap])
    used = FittedPositions(places.stimulus[kept], places.position_mm[kept], places.rate[kept], places.error[kept])
    found = replace(world.answer, rows=rows, places=used, left_out=(LeftOut(title, (x,), (rate,)),))
    for plot in (verdict_figures.the_answer(found, [0, 1], ""), verdict_figures.profiles(found, [0, 1], "")):
        axes = _drawn_alone(plot)[0]
        assert [cross.tolist() for cross in _lines(axes, marker="x")] == [[[x], [rate]]]
        lines = [line for line in axes.lines if line.get_linestyle() != "None"]
        assert lines
        for line in lines:
            at_x, y = (np.asarray(values, dtype=float) for values in line.get_data())
            assert np.isnan(y[at_x == x]).all()
            assert (at_x == x).any()


@pytest.mark.parametrize("saturation", [0.0, 0.02])
def test_the_line_of_a_fit_is_the_fit_also_between_the_points(world: World, saturation: float) -> None:
    """It has its corner where k(ε − ε₀) is zero, wherever the recorded positions lie."""
    rows = tuple(
        replace(row, k=10.0, eps0=float(np.mean(row.eps[:2])), saturation=saturation)
        for row in world.answer.rows
        if np.isfinite(row.eps).all() and np.ptp(row.eps) > 0
    )
    found = replace(world.answer, rows=rows)
    pairs = verdict_figures.plotted_pairs(found)
    for axes, row in zip(_drawn_alone(verdict_figures.scatter(found, "")), pairs, strict=True):
        ((eps, rate),) = _lines(axes, ls="-")
        drive = np.maximum(row.k * (eps - row.eps0), 0.0)
        np.testing.assert_allclose(rate, drive / (1 + saturation * drive))
        assert row.eps0 in eps
        assert len(eps) > 3 * len(np.unique(row.eps.round(9)))


def test_it_is_printed_at_its_own_size_and_can_be_read(drawn: Drawn) -> None:
    """Of a run and of a comparison: an A4 page would shrink a larger one, with its letters."""
    for name in (one for one in FIGURES if one.startswith(("run_figures.", "profile_figures.", "verdict_figures."))):
        page, figure = drawn(name)
        width, height = page.plot.size
        assert (width <= PAGE_IN[0]) & (height <= PAGE_IN[1]), name
        shown_ = [one for one in figure.findobj(Text) if one.get_text().strip() and one.get_visible()]  # type: ignore[attr-defined]
        assert min(one.get_fontsize() for one in shown_) >= LEAST_POINTS, name  # type: ignore[attr-defined]
        ink = figure.get_tightbbox()  # in inches
        assert min(ink.x0, ink.y0) >= 0, f"{name} is cut off"
        assert (ink.x1 <= width) & (ink.y1 <= height), f"{name} is cut off"


CLAIM = re.compile(
    r"\b(black|gray|blue|orange|green|purple|yellow|white)\b(?!: (?:nothing|no fit|lateral|zero))", re.I
)


@pytest.mark.parametrize("name", FIGURES)
def test_its_caption_is_true(name: str, drawn: Drawn) -> None:
    page, figure = drawn(name)
    there = {to_hex(colour) for axes in _axes(figure) for artist in axes.get_children() for colour in _of(artist)}
    for word in CLAIM.findall(page.caption):
        assert to_hex(COLOURS[word.lower()]) in there, word
    lines = [line for axes in _panels(figure) for line in axes.lines]
    dotted = [line for line in lines if _is_dotted(line)]
    for line in dotted:
        gap = line._dash_pattern[1][1]  # type: ignore[attr-defined]
        assert gap >= LEAST_GAP_PT, f"gaps of {gap:.2f} pt look solid"
    assert dotted or "dotted" not in page.caption.lower()
    if "cross" in page.caption.lower():
        assert any(_is(line, marker="x") for line in lines)
    if "circles" in page.caption.lower():
        assert any(_is(line, marker="o") for line in lines)
    if "shaded" in page.caption.lower():
        assert any(axes.patches for axes in _panels(figure))
    if "hatched" in page.caption.lower():
        assert any(patch.get_hatch() for axes in _panels(figure) for patch in axes.patches)


def _is_dotted(line: Line2D) -> bool:
    """Whether its dashes are shorter than the gaps between them."""
    pattern = line._dash_pattern[1]  # type: ignore[attr-defined]
    return pattern is not None and line.get_linestyle() != "None" and pattern[0] <= pattern[1]


def _of(artist: Artist) -> Iterator[Any]:
    if isinstance(artist, Line2D):
        yield artist.get_color()
        if artist.get_marker() not in ("None", ""):
            yield from (artist.get_markerfacecolor(), artist.get_markeredgecolor())
    elif isinstance(artist, Patch):
        yield from (artist.get_facecolor(), artist.get_edgecolor())
    elif isinstance(artist, Collection) and artist.get_array() is None:
        yield from (*artist.get_facecolor(), *artist.get_edgecolor())  # type: ignore[misc]
    elif isinstance(artist, Collection):
        yield from artist.get_edgecolor()  # type: ignore[misc]


@pytest.mark.parametrize("name", FIGURES)
def test_its_legend_is_of_what_is_drawn(name: str, drawn: Drawn) -> None:
    _, figure = drawn(name)
    lines = [line for axes in _panels(figure) for line in axes.lines if len(_data(line))]
    there = {to_hex(colour) for axes in _panels(figure) for artist in axes.get_children() for colour in _of(artist)}
    boxes = [one for part in (figure, *figure.subfigs) for one in part.legends]
    boxes += [one for axes in _axes(figure) if (one := axes.get_legend()) is not None]
    for box in boxes:
        for handle, text in zip(box.legend_handles, box.get_texts(), strict=True):
            if isinstance(handle, Line2D):
                style = handle.get_linestyle(), handle.get_marker()
                colours = (
                    {_tint(handle)} if _tint(handle) != GREY.lower() else {_tint(line) for line in lines}
                )  # of any
                sure = [
                    line
                    for line in lines
                    if (line.get_linestyle(), line.get_marker()) == style and _tint(line) in colours
                ]
                assert sure or text.get_text() in MAY_BE_ABSENT, f"nothing is drawn as {text.get_text()!r}: {style}"
            elif handle is not None:
                assert set(map(to_hex, _of(handle))) & there, text.get_text()


def _tint(line: Line2D) -> str:
    return to_hex(line.get_color() if line.get_linestyle() != "None" else line.get_markeredgecolor())


MAY_BE_ABSENT = ("in the set", "not rejected, but worse", "rejected by its fit", "squares: controls")
"""Entries of a legend that is the same for every recording."""


# --- labels of all programs ---


def _written_labels() -> Iterator[tuple[str, str]]:
    """Every label of an axis that is written out in the sources, with its place."""
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
    assert len(found) > 40
    assert not [(place, text) for place, text in found if not re.search(r"\([^()]*\)$", text.replace("\n", " "))]


def test_controls_have_units() -> None:
    assert [verdict_figures.measured_in(name) for name in CONTROLS] == [
        "skin pressure (kPa)", "skin displacement (mm)", "indentor curvature (1/mm)", "half-space strain (1)",
    ]  # fmt: skip
