"""The same input gives the same numbers, whatever the cache holds, in any order, on any number of processes.

A model that is read equals one that was built to the last bit. Strain at receptors that are added to a model in the
cache comes from another factorization of the same stiffness, and builds on other numbers of threads sum in another
order: both are rounding, far below the residual to which a contact is solved.
"""

import csv
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from rig.compare.plausible_fingers import PlausibleFingers, on_plausible_fingers
from rig.compare.stimuli import stimuli
from rig.data import Run
from rig.data.run import read_run
from rig.plan.config import Config
from rig.plan.plan import make_plan
from rig.protocol.script import load_script
from rig.session.session import NewRun, Session, dry_run
from rig.study import parallel, parameter_study
from sim.config import FingertipConfig
from sim.contact.solver import TARGET_RESIDUAL
from sim.identification.force_table import ChebyshevAxis, Scope, ShapeTable
from sim.measures.receptors import ReceptorPlaces
from sim.models.fingertip import Fingertip
from sim.models.interpolation import forget_kept, make_node, nodes_for
from sim.models.many_indentations import indent_many
from sim.models.result import IndentationResult
from sim.models.sources import made
from sim.workers import in_processes
from tests.program import Program
from tests.sim.coarse_mesh import as_toml, coarse_mesh

BELOW = {"growth": 2.0, "far_growth": 3.0, "far_spacing_mm": 3.0}
MESH = coarse_mesh(0.7, 0.7, patch_x_mm=1.4, patch_z_mm=1.4, **BELOW)
CONFIG = FingertipConfig(mesh=MESH)
RECEPTORS = ReceptorPlaces.of((0.0,), 0.76, None)
STUDY = """\
receptor_x_mm = [0.0]

{mesh}
[finger.tissue]
e_fat = {e_fat}

[[press]]
shape = "cylinder:9"
x_mm = {x_mm}
doi_mm = 0.1
"""
SCRIPT = """\
from rig.protocol import Rig

def run(rig: Rig) -> None:
    rig.mount("cylinder:9")
    rig.home()
    rig.zero()
    for x_mm in (-0.2, 0.0, 0.2):
        rig.move_to(x_mm=x_mm)
        rig.indent(doi_mm=0.1, hold_s=0.2)
"""
PRESSES = (("cylinder:9", 0.1, 0.1), ("step:1", -0.1, 0.15), ("cylinder:9", 0.1, 0.2), ("step:1", -0.1, 0.05))
MOMENTS = {"wall_s", "build_s", "contact_s", "from_cache", "took_s", "time_s"}
"""Of JSON: what differs between two runs of the same command."""

Numbers = dict[str, Any]


class Request(NamedTuple):
    """What a way to numbers is given."""

    program: Program
    folder: Path
    run: Run
    backwards: bool
    processes: int
    indentor: str = "cylinder:9"

    def written(self, name: str, text: str) -> Path:
        path = self.folder / name
        path.write_text(text, encoding="utf-8")
        return path

    def ordered(self, items: Sequence[Any]) -> list[Any]:
        return list(items)[:: -1 if self.backwards else 1]

    @property
    def config(self) -> Path:
        return self.written("rig.toml", as_toml(MESH))


def of_a_study(request: Request) -> Numbers:
    """Of two fingers that differ in a modulus: fewer than it takes to interpolate."""
    e_fat, x_mm = request.ordered([0.05, 0.1]), request.ordered([0.1, -0.1])
    study = request.written("study.toml", STUDY.format(mesh=as_toml(MESH), e_fat=e_fat, x_mm=x_mm))
    request.program("study", study, "--processes", request.processes)
    with study.with_suffix(".csv").open(encoding="utf-8") as stream:
        return {f"{row['tissue.e_fat']} {row['x_mm']}": row for row in csv.DictReader(stream)}


def of_one_press(request: Request) -> Numbers:
    how = ("--shape", "cylinder:9", "--x-mm", 0.1, "--doi-mm", 0.1, "--model", "finger", "--receptor-x-mm", "0")
    return timeless(request.program("indent", *how, "--config", request.config, "--json").json)


def of_a_dry_run(request: Request) -> Numbers:
    script = request.written("script.py", SCRIPT)
    how = ("--config", request.config, "--out", request.folder / "runs", "--json")
    run = read_run(Path(request.program("dry-run", script, *how).json["run"]))
    return {stream: run.stream(stream) for stream in ("touch", "hold_end", "indentation_end")}


def of_plausible_fingers(request: Request) -> Numbers:
    finger = Fingertip.load(CONFIG, **RECEPTORS.as_options())
    ranges = PlausibleFingers("--fingers x.toml", {"tissue.e_fat": (0.08, 0.12)})
    found = on_plausible_fingers(request.run, stimuli(request.run, finger), finger, ranges)
    return {one.title: [one.measures.tolist(), np.asarray(one.on_fingers).tolist()] for one in found}


def of_a_force_table(request: Request) -> Numbers:
    """Of an identification: its fingers are always interpolated."""
    axis = ChebyshevAxis("e_fat", 0.08, 0.12, 2)
    scope = Scope((axis,), 0.2, (0.03, 0.15), places=2, depths=2)
    found = ShapeTable.read_or_make(request.indentor, scope, finger_of_fat, CONFIG.model_dump_json())
    return {name: array.tolist() for name, array in found.arrays.items()}


def finger_of_fat(values: Any) -> Fingertip:
    tissue = CONFIG.tissue.model_copy(update={**values, "stiffening": 0.1})
    config = CONFIG.model_copy(update={"tissue": tissue})
    return Fingertip.load(config, **RECEPTORS.as_options(), exact=False)


def of_an_interpolated_finger(request: Request) -> Numbers:
    finger = Fingertip.load(CONFIG, **RECEPTORS.as_options(), exact=False)
    return numbers_of(finger.indent("cylinder:9", 0.1, doi_mm=0.1))


def of_single_presses(request: Request) -> Numbers:
    """Of one finger after the other, one of which keeps its ways."""
    finger, found = Fingertip.load(CONFIG, **RECEPTORS.as_options()), Numbers()
    for one in (finger, finger.keeping_ways()):
        for shape, x_mm, doi_mm in request.ordered(PRESSES):
            answer = numbers_of(one.indent(shape, x_mm, doi_mm=doi_mm))
            assert found.setdefault(f"{shape} {doi_mm}", answer) == answer
    return found


def of_many_presses(request: Request) -> Numbers:
    finger, rows = Fingertip.load(CONFIG, **RECEPTORS.as_options()), request.ordered(PRESSES)
    shapes, x_mm, doi_mm = (list(each) for each in zip(*rows, strict=True))
    found = indent_many(finger, shapes, x_mm, doi_mm=doi_mm, cores=request.processes)
    return {f"{shape} {doi}": numbers_of(found[k]) for k, (shape, _, doi) in enumerate(rows)}


def numbers_of(result: IndentationResult) -> Numbers:
    return {"force_n": result.force_n} | {name: each.tolist() for name, each in result.receptor_measures.items()}


def timeless(found: Any) -> Any:
    """JSON without what tells of the clock."""
    if isinstance(found, dict):
        return {name: timeless(value) for name, value in found.items() if name not in MOMENTS}
    return [timeless(value) for value in found] if isinstance(found, list) else found


WAYS: dict[str, Callable[[Request], Numbers]] = {
    "rig study": of_a_study,
    "rig indent": of_one_press,
    "rig dry-run": of_a_dry_run,
    "rig compare --fingers": of_plausible_fingers,
    "rig identify, a table": of_a_force_table,
    "Fingertip.load(exact=False)": of_an_interpolated_finger,
    "Fingertip.indent": of_single_presses,
    "indent_many": of_many_presses,
}
IN_PROCESSES = ("rig study", "indent_many")


@pytest.fixture(scope="module")
def neighbours(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cache with the builds between which fingers are interpolated, and fingers beside the requested ones."""
    folder = tmp_path_factory.mktemp("neighbours")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RIG_CACHE_DIR", str(folder))
        for node in nodes_for(CONFIG, RECEPTORS):
            make_node(node)
        for e_fat in (0.08, 0.09, 0.11, 0.12):
            tissue = CONFIG.tissue.model_copy(update={"e_fat": e_fat})
            Fingertip.load(CONFIG.model_copy(update={"tissue": tissue}), **RECEPTORS.as_options())
        forget_kept()
    return folder


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    folder = tmp_path_factory.mktemp("run")
    path = folder / "script.py"
    path.write_text(SCRIPT, encoding="utf-8")
    script, config, finger = load_script(str(path)), Config(finger=CONFIG), Fingertip.load(CONFIG)
    return dry_run(Session(script, config, finger, make_plan(script, config, finger), NewRun(folder))).run


Ask = Callable[..., Numbers]


@pytest.fixture
def ask(program: Program, tmp_path: Path, run: Run, empty_figures: None, monkeypatch: pytest.MonkeyPatch) -> Ask:
    """Ask a way to numbers, with a cache that is a copy of another, or empty; nothing is kept in memory."""
    asked: list[str] = []

    def ask(way: str, cache: Path | None = None, *, backwards: bool = False, processes: int = 1) -> Numbers:
        asked.append(way)
        folder = tmp_path / str(len(asked))
        folder.mkdir()
        if cache is not None:
            shutil.copytree(cache, folder / "cache")
        monkeypatch.setenv("RIG_CACHE_DIR", str(folder / "cache"))
        forget_kept()
        made.cache_clear()
        parameter_study._finger.cache_clear()
        return WAYS[way](Request(program, folder, run, backwards, processes))

    return ask


@pytest.mark.parametrize("way", WAYS)
def test_cache_and_order_of_requests_change_no_result(way: str, ask: Ask, neighbours: Path) -> None:
    found = ask(way)
    assert found
    assert ask(way, neighbours, backwards=True) == found


@pytest.mark.parametrize("way", IN_PROCESSES)
def test_two_processes_give_the_same_results_as_one(way: str, ask: Ask, monkeypatch: pytest.MonkeyPatch) -> None:
    found = ask(way)
    monkeypatch.setattr(parallel, "in_processes", in_processes)
    assert ask(way, processes=2) == found


def test_receptors_added_to_a_cached_model_change_results_only_by_rounding(
    ask: Ask, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Their strain comes from another factorization: rounding, below what the contact is solved to."""
    found = ask("Fingertip.indent")
    cache = tmp_path / "others"
    monkeypatch.setenv("RIG_CACHE_DIR", str(cache))
    Fingertip.load(CONFIG)
    again = ask("Fingertip.indent", cache)
    assert again.keys() == found.keys()
    for name, one in found.items():
        assert again[name]["force_n"] == one["force_n"]
        for measure, values in one.items():
            np.testing.assert_allclose(again[name][measure], values, rtol=TARGET_RESIDUAL, err_msg=measure)


def test_an_edited_shape_file_has_its_own_cached_results(
    program: Program, tmp_path: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An edited file of the same name has answers of its own, on a cache that holds those of the first."""
    monkeypatch.setenv("RIG_CACHE_DIR", str(tmp_path / "cache"))
    path, found = tmp_path / "shape.csv", []
    for steep in (0.1, 0.3, 0.1):
        rows = "".join(f"{x},{steep * x * x}\n" for x in np.linspace(-2.0, 2.0, 41).round(3).tolist())
        path.write_text(f"x_mm,height_mm\n{rows}", encoding="utf-8")
        found.append(of_a_force_table(Request(program, tmp_path, run, False, 1, f"profile:{path}")))
    assert found[0] != found[1]
    assert found[0] == found[2]
