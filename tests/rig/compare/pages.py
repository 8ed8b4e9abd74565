"""What the pages of the tests are made of: recordings, designs, fingers and presses made by hand."""

import json
import shutil
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.compare.comparison import Comparison, compare
from rig.compare.example import PHASES, judge_phase, positions, recorded, rehearse
from rig.compare.group import group_verdict
from rig.compare.likelihood import Form
from rig.compare.make_verdict import afferents, answers, candidate_pool
from rig.compare.recordings.recording import recording
from rig.compare.stimuli import StimulusMap, StimulusRow, deepest_map
from rig.data import Run
from rig.data.folder import RunFolder
from rig.data.spike_files import SpikeRecord, SpikeTrain, read_spikes
from rig.design.choose import AddedPresses, ChosenPresses
from rig.design.confusion import Confusion, OrderedDesign
from rig.design.design import Design, DesignRequest
from rig.design.presses import PossiblePress
from rig.plan.config import load_config
from rig.plan.finger_model import PredictedHold, responses
from rig.report import benchmark_page, coding_figures, profile_figures, run_figures
from rig.report.comparison_report import write_comparison
from rig.report.design_page import DesignPage, write_design_page
from rig.report.example_page import example_sections
from rig.report.group_page import GroupPage, write_group_page
from rig.report.identification_page import ForceBand, IdentificationPage, write_identification_page
from rig.report.nerve_figures import nerve_figures
from rig.report.page_source import source_line
from rig.report.plot import Plot
from rig.report.recording_sections import Deflection, deflection_section
from rig.report.run_report import run_page_figures, write_report
from rig.report.run_tables import by_target, conditions, delivered, write_numbers
from rig.report.strain_figure import strain_figures
from sim.coding.encoding import Encoded
from sim.coding.point_spread import Judged, PointSpread, Sheet
from sim.coding.power_law import PowerLaw
from sim.coding.raju_table_6_1 import Deformed
from sim.coding.section import Sampling
from sim.config import FingertipConfig
from sim.identification.posterior import Learned
from sim.identification.predicted_forces import MeasuredPress, PressTrajectory
from sim.identification.prior import PARAMETERS, Prior
from sim.identification.uncertainty_bands import Width
from sim.models.fingertip import Fingertip
from tests.sim.coarse_mesh import coarse_mesh

ROOT = Path(__file__).parents[3]
Make = Callable[..., StimulusRow]
Array = NDArray[np.float64]
DAY_S = 86400.0

X = np.linspace(-4.0, 4.0, 33)
RECEPTORS = np.array([-0.5, 0.0, 0.5])
POSITIONS = np.linspace(-4.25, 5.25, 20)
"""Recorded positions; the runs do not cover the first and the last of them at every receptor."""
RATE = 40.0 + 20.0 * np.cos(POSITIONS)


def made_design() -> Design:
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


def made_comparison(make_stimulus: Callable[..., StimulusRow], rate: Array = RATE) -> Comparison:
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


def judged(make_stimulus: Callable[..., StimulusRow]) -> dict[str, Any]:
    """Candidates and verdict of each of three afferents, whose rates differ a little."""
    found = {}
    for number in range(3):
        comparison = made_comparison(make_stimulus, RATE + 5 * np.sin(np.arange(len(RATE)) + number))
        (overlays,), (verdict,) = afferents(comparison), answers(comparison)
        pool = candidate_pool(overlays, Form())
        assert pool is not None
        found[f"a{number}"] = pool, verdict
    return found


def strain_maps(comparison: Comparison) -> list[StimulusMap]:
    corners = np.stack(np.meshgrid(np.linspace(-9, 9, 7), np.linspace(8, 2, 4), indexing="ij"), axis=-1)
    values = np.linspace(0, 1, 18).reshape(6, 3)
    at = np.array([[0.0, 5.0], [1.0, 5.5]])
    return [
        StimulusMap(comparison.stimuli[0], x, corners, at, {"sed": values, "ep1": values}) for x in (-1.0, 0.0, 1.0)
    ]


def identified() -> IdentificationPage:
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
    return IdentificationPage(
        forces, presses, learned[0], learned[1], [], [], [], [], bands, "2026-11-29 · run a (virtual bench)"
    )


def deflections() -> tuple[list[Deflection], list[Deflection]]:
    z = np.linspace(2.0, 10.0, 30)
    model = [Deflection(doi, z, doi * np.exp(-((z - 6.0) ** 2))) for doi in (0.5, 1.0)]
    measured = [Deflection(0.5, z[::6], 0.4 + 0 * z[::6]), Deflection(float("nan"), z[::7], 0.2 + 0 * z[::7])]
    return model, measured


def speed() -> list[dict[str, Any]]:
    return [
        {"model": model, "element": element, "refinement": f"{nodes}", "nodes": nodes, "scene": "s", "family": family,
         "quantity": quantity, "error": 0.1 / nodes**0.5 * (1 + k), "total_s": 1e-3 * nodes, "contact_s": 0.01,
         "memory_mb": nodes / 10}
        for model, element in (("finger", "bbar"), ("section", "bbar"))
        for nodes in (100, 1000)
        for family in ("smooth", "bar", "step")
        for k, quantity in enumerate(("force", "sed"))
    ]  # fmt: skip


def coding() -> dict[str, Any]:
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
        "point_spread": coding_figures.PointSpreadPlot(
            Deformed(nodes, 0.1 * np.ones_like(nodes)),
            Judged(spread, PowerLaw(3.0, 1.5, 0.9, 0.8), PowerLaw(4.0, 1.7, 0.9, 0.8)),
        ),
        "search": ({"valley": surface}, {"exact": path, "grid": path[:2]}, np.array([20.0, 14.0])),
        "sheet": coding_figures.SheetPlot(
            np.array([0.0, 1.0]), np.array([5.0, 6.0, 7.0]), np.arange(6.0).reshape(2, 3), np.ones((2, 3)),
            np.array([[0.5, 5.5]]),
        ),
    }  # fmt: skip


def resumed(run: Run) -> Run:
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


LIKELY = ("sed", "ep1", "e22", "mean", "s22", "e11", "e12")
"""Candidates of an adaptive run, the most probable one first; the last two are grey."""


def adaptive(run: Run) -> Run:
    """The same run, with choices: the probabilities part from one another with each of two counts."""
    events = []
    for number in range(3):
        weight = np.linspace(2.0, 1.0, len(LIKELY)) ** number
        found = dict(zip(LIKELY, (weight / weight.sum()).tolist(), strict=True))
        possible = None if number == 2 else number
        reason = "one_candidate" if possible is None else "same_shape"
        press = {"indentor": "bar:3.0", "x_mm": -0.4, "target": "doi_mm", "value": 0.4}
        choice = {"possible": possible, "reason": reason, "probabilities": json.dumps(found)}
        events.append({"t_s": run.start["t_s"], "index": number, **press, **choice})
    source = {"t_s": run.start["t_s"], "truth": '{"candidate": "ep1"}', "source": "virtual:ep1", "presses": 4}
    units = {**run.units, "choice": {}, "count_source": {}}
    return replace(run, events={**run.events, "choice": events, "count_source": [source]}, units=units)


# --- pages ---


class World(SimpleNamespace):
    """What the figures of a page are drawn of; of a run only some `presses`, if their number is given."""

    presses: int | None = None


class Made(NamedTuple):
    """A page, or figures without one, the runs that it is of, and what it was made of."""

    world: World
    html: str = ""
    runs: tuple[str, ...] = ()
    figures: Sequence[Plot] = ()


def _run_figures(world: World) -> Made:
    return Made(world, figures=run_page_figures(world.run, list(world.found), read_spikes(world.run.folder)))


def _own(run: Run, path: Path, found: Sequence[PredictedHold]) -> Run:
    """The run in a folder of its own, with the numbers of some answers of a finger."""
    folder = Path(tempfile.mkdtemp(dir=path.parent)) / "run"
    own = replace(run, folder=RunFolder(shutil.copytree(run.folder.path, folder)))
    write_numbers(own, found)
    return own


def _of_run(path: Path, run: Run, finger: Fingertip, make_stimulus: Make) -> Made:
    own = _own(run, path, responses(run, finger))
    page = write_report(own, finger, further=strain_figures(own, finger))
    strain = deepest_map(own, finger)
    return Made(World(run=own, found=responses(own, finger), maps=[strain]), page.read_text(encoding="utf-8"))


def _of_human(path: Path, run: Run, finger: Fingertip, make_stimulus: Make) -> Made:
    mesh = coarse_mesh(0.5, 1.0, patch_x_mm=4.0, patch_z_mm=2.5)
    config = load_config(ROOT / "examples" / "human_finger" / "finger.toml").finger
    human = Fingertip.load(config.model_copy(update={"mesh": mesh}))
    large = [
        replace(one, result=human.indent("bar:3.0", one.result.x_mm, doi_mm=0.4)) for one in responses(run, finger)
    ]
    return _run_figures(World(run=_own(run, path, large), found=large))


def _of_one_press(path: Path, run: Run, finger: Fingertip, make_stimulus: Make) -> Made:
    """Of one press, with an edge that touches on less than the 0.17 mm between nodes beside a flat."""
    narrow = finger.indent("step:1", -1.63, force_gwt=2.33)
    found = [replace(responses(run, finger)[0], result=narrow)]
    of_press = run_figures.delivered_presses(delivered(run)[:1])
    contact = run_figures.contact_panels([found], run_figures.highest_pressure(found))
    return Made(
        World(run=_own(run, path, found), presses=1, found=found),
        figures=[
            of_press,
            contact,
            run_figures.population_responses(found, moved=False),
            run_figures.presses(run, by_target(conditions(run)[:1])),
        ],
    )


def _of_relief(path: Path, run: Run, finger: Fingertip, make_stimulus: Make) -> Made:
    found = [one for one in responses(run, finger) if one.last]
    results, titles = [one.result for one in found], ["x"] * len(found)
    return Made(World(run=run, found=found), figures=[run_figures.contacts_from_below(results, titles)])


def _of_spikes(n: int) -> Callable[..., Made]:
    def make(path: Path, run: Run, finger: Fingertip, make_stimulus: Make) -> Made:
        """Of three classes; every other afferent is silent, as all of the last are before the first hold ends."""
        chance = np.random.default_rng(3)
        times = [np.sort(chance.uniform(run.start["t_s"], run.end_s, 60 * (k % 2 == 0))) for k in range(n)]
        names = [("SA1", "RA", "PC")[k % 3] for k in range(n)]
        trains = [
            SpikeTrain(f"{name}-{k}", name, 0.0, 0.0, 0.76, 1.0, 0.0, spike_s)
            for k, (name, spike_s) in enumerate(zip(names, times, strict=True))
        ]
        record = SpikeRecord(tuple(trains), 0, 0.2)
        return Made(World(run=run, spikes=record), figures=nerve_figures(run, record))

    return make


def of_comparison(rate: Any, *, recorded: bool = True, title: str = "") -> Callable[..., Made]:
    def make(path: Path, run: Run, finger: Fingertip, make_stimulus: Make) -> Made:
        comparison = made_comparison(make_stimulus, rate)
        if not recorded:
            comparison = replace(comparison, overlays=())
        maps, verdicts = strain_maps(comparison), answers(comparison)
        runs = () if title else (run,)
        write_comparison(path, comparison, runs, finger, f"rig compare{title}", answers=verdicts, maps=maps)
        world = World(run=run, comparison=comparison, answer=next(iter(verdicts), None), maps=maps)
        return Made(world, path.read_text(encoding="utf-8"), tuple(one.folder.path.name for one in runs))

    return make


def _of_few(path: Path, run: Run, finger: Fingertip, make_stimulus: Make) -> Made:
    """Of five positions, and of one receptor with both signs: zero would get a contour, which it cannot have."""
    one = made_comparison(make_stimulus).stimuli[0]
    few = replace(one, x_mm=X[:5], measures=one.measures[:, :5])
    alone = replace(one, measures=one.measures[:, :, :1], receptor_mm=one.receptor_mm[:1])
    figures = [profile_figures.populations(few, ["ep1"]), profile_figures.populations(alone, ["ep3"])]
    return Made(World(), figures=figures)


def _of_recorded_bar(path: Path, run: Run, finger: Fingertip, make_stimulus: Make) -> Made:
    coarse = Fingertip.load(FingertipConfig(mesh=coarse_mesh(0.5, 0.5)), receptor_x_mm=(-0.5, 0.0))
    rehearsal = rehearse(coarse, positions()[3:-3:2])
    verdicts = [judge_phase(rehearsal, recorded(phase), phase) for phase in PHASES]
    figures = [one for section in example_sections(rehearsal, verdicts) for one in section.figures]
    return Made(World(rehearsal=rehearsal), figures=figures)


def _of_group(path: Path, run: Run, finger: Fingertip, make_stimulus: Make) -> Made:
    candidates, comparison = judged(make_stimulus), made_comparison(make_stimulus)
    found = {name: {o.stimulus.shape: o.recording for o in comparison.overlays} for name in (*candidates, "a9")}
    verdicts = {name: one for name, (_, one) in candidates.items()}
    group = group_verdict(candidates)
    write_group_page(
        path, GroupPage(group, verdicts, found, {"a9": "it hardly fired"}, [run], "rig compare", "small")
    )
    return Made(World(group=group), path.read_text(encoding="utf-8"), (run.folder.path.name,))


def _of_identification(path: Path, run: Run, finger: Fingertip, make_stimulus: Make) -> Made:
    rows = [("1", "bar:3.0", "-1.2", "0.40", "5.1 (4 … 6)", "5.20", "± 8 %")]
    forces = [("bar:3.0", "+0.0", "0.67", "7.00 (6.60 … 7.50)", "± 6 %")]
    page = replace(identified(), source=source_line([run]), presses=rows, forces=forces)
    write_identification_page(path, page)
    return Made(World(identified=page), path.read_text(encoding="utf-8"), (run.folder.path.name,))


def whole_design(**changed: Any) -> Design:
    """A design of three presses, two of which differ; an hour has room for two of the three possible ones."""
    found = made_design()
    block = np.array([0, 1, 0])
    table: Any = SimpleNamespace(presses=found.table.presses)
    bound = replace(found.bound, name="all presses", minutes=60.0, presses=2, different=2)
    return replace(found, table=table, blocks=(block,), bound=bound, **changed)


def _of_design(path: Path, run: Run, finger: Fingertip, make_stimulus: Make) -> Made:
    design = whole_design()
    write_design_page(path, DesignPage(design, "designed.py", 590.0, [], "rig design"))
    return Made(World(design=design), path.read_text(encoding="utf-8"))


def _of_benchmark(path: Path, run: Run, finger: Fingertip, make_stimulus: Make) -> Made:
    levels = {level: {"nodes": 1} for level in ("fine", "coarse", "further")}
    further = {family: dict.fromkeys(("force",), 0.01) for family in ("smooth", "bar", "step")}
    reference = {"bars": further, "provenance": {"command": "c", "levels": levels, "further": further}}
    rows = speed()
    html = benchmark_page.page(
        rows, machine="two cores", wall_s=1.0, quick=True, reference_s=1.0, reference=reference,
        quantities={"force": "force"}, steps=(), breakdown=[], calculix=None, no_calculix="–",
    )  # fmt: skip
    return Made(World(speed=rows), html)


def _of_deflection(path: Path, run: Run, finger: Fingertip, make_stimulus: Make) -> Made:
    comparison, profiles = replace(made_comparison(make_stimulus), overlays=()), deflections()
    extra = [deflection_section(*profiles, "mine.csv")]
    write_comparison(path, comparison, [run], finger, "rig compare --deflection mine.csv", extra)
    world = World(comparison=comparison, deflections=profiles)
    return Made(world, path.read_text(encoding="utf-8"), (run.folder.path.name,))


def _of_coding(path: Path, run: Run, finger: Fingertip, make_stimulus: Make) -> Made:
    """The pictures of `rig encode` and `rig decode`, which are on no page."""
    of = coding()
    draw = {name: getattr(coding_figures, f"{name}_figure") for name in of}
    figures = [draw[name](*(given if name == "search" else (given,))) for name, given in of.items()]
    return Made(World(coding=of), figures=figures)


PAGES: dict[str, Callable[[Path, Run, Fingertip, Make], Made]] = {
    "comparison": of_comparison(RATE),
    "comparison without a recording": of_comparison(RATE, recorded=False),
    "example": of_comparison(RATE, title=" --example bar3"),
    "deflection": _of_deflection,
    "group": _of_group,
    "identification": _of_identification,
    "design": _of_design,
    "benchmark": _of_benchmark,
}
REPEATED = ("example", "comparison without a recording")
"""Pages whose figures are those of a comparison, and of a deflection."""
FIGURES = {name: make for name, make in PAGES.items() if name not in REPEATED} | {
    "run": _of_run,
    "run resumed": lambda path, run, *_: _run_figures(World(run=resumed(run), found=())),
    "run of choices": lambda path, run, *_: _run_figures(World(run=adaptive(run), found=())),
    "run on a human finger": _of_human,
    "run of one press": _of_one_press,
    "run with a relief": _of_relief,
    "run with one afferent": _of_spikes(1),
    "run with few afferents": _of_spikes(8),
    "run with many afferents": _of_spikes(60),
    "few positions, one receptor": _of_few,
    "recorded bar": _of_recorded_bar,
    "coding": _of_coding,
}
"""Pages, and figures that the walk of all figures sees besides."""
