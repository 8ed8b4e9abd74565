"""Many presses by one call: broadcast, in order, over processes, each as if it were the only one."""

import os
import pickle
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim.config import FingertipConfig
from sim.contact.indentor import Indentor
from sim.contact.profiles import Bar, Cylinder
from sim.errors import ArgumentError
from sim.measures.measures import MEASURES
from sim.models import many_indentations
from sim.models.fingertip import Fingertip
from sim.models.many_indentations import WorkerLostError, indent_many
from sim.models.result import IndentationOutcome, IndentationRequest, Indentations
from sim.tables import NotInstalledError, to_pandas, to_xarray, write_csv
from sim.workers import in_processes
from tests.error_codes import raises


@pytest.fixture(scope="module")
def coarse(coarse_config: FingertipConfig) -> Fingertip:
    """For algebra, not for mechanics."""
    return Fingertip.load(coarse_config, receptor_x_mm=(0.0, 0.5))


def _asked(found: Indentations) -> list[tuple[Any, ...]]:
    return [tuple(one) for one in found.asked]


MIXED = {
    "shapes": ["step:1", "bar:1", "step:1", "cylinder:9", "bar:1", "sphere:3", "step:1", "bar:1"],
    "x_mm": [-0.4, 0.0, -0.4, 0.1, 0.0, 0.1, -0.4, 0.0],
    "z_mm": [np.nan] * 5 + [7.0] + [np.nan] * 2,
    "doi_mm": [0.28, 0.21, 0.11, 0.2, 0.27, 0.2, np.nan, np.nan],
    "force_gwt": [np.nan] * 6 + [0.5, 0.5],
}


@pytest.fixture(scope="module")
def mixed(coarse: Fingertip) -> Indentations:
    """Shapes, places, depths and forces in any order; sharp ones several times at a place, not the deepest last."""
    return indent_many(coarse, **MIXED)  # type: ignore[arg-type]


def test_each_of_many_presses_equals_a_press_alone(coarse: Fingertip, mixed: Indentations) -> None:
    for asked, found in zip(mixed.asked, mixed, strict=True):
        alone = coarse.indent(
            asked.shape, asked.x_mm, z_mm=asked.z_mm, doi_mm=asked.doi_mm, force_gwt=asked.force_gwt
        )
        assert found is not None
        assert found.force_n == alone.force_n
        assert found.doi_mm == alone.doi_mm
        assert found.state.passes == alone.state.passes
        assert np.array_equal(found.state.displacement, alone.state.displacement)
        assert np.array_equal(found.receptor_strain, alone.receptor_strain)
    assert mixed.problems == [""] * 8


def test_many_presses_in_two_processes_give_the_same_results_in_order(coarse: Fingertip, mixed: Indentations) -> None:
    seen: list[tuple[int, int]] = []
    found = indent_many(coarse, **MIXED, cores=2, progress=lambda *done: seen.append(done))  # type: ignore[arg-type]
    table, alone = found.table(), mixed.table()
    for name in set(table) - {"contact_s"}:
        assert np.array_equal(table[name], alone[name], equal_nan=table[name].dtype.kind == "f"), name
    receptors = found.receptor_table()
    for name, values in mixed.receptor_table().items():
        assert np.array_equal(receptors[name], values), name
    assert seen[-1] == (8, 8)
    assert [done for done, _ in seen] == sorted({done for done, _ in seen})
    bars = [result for result in found if result is not None and len(result.indentor.axes) == 1]
    assert len({id(result.model) for result in bars}) == 1  # what they keep of the model is kept once


def test_the_rows_of_many_presses_are_the_broadcast_arguments(
    coarse: Fingertip, monkeypatch: pytest.MonkeyPatch
) -> None:
    nothing = IndentationOutcome(None, "not asked")
    monkeypatch.setattr(many_indentations, "_press", lambda *_: nothing)
    bar, own = Indentor.along(Bar(2.0)), Cylinder(4.0)
    grid = indent_many(coarse, "bar:1", np.array([[0.0], [1.0]]), doi_mm=[0.1, 0.2])
    assert _asked(grid) == [("bar:1", x, None, doi, None) for x in (0.0, 1.0) for doi in (0.1, 0.2)]
    shapes = indent_many(coarse, [bar, own, "line"], z_mm=[np.nan, np.nan, 7.0], force_gwt=2)
    assert _asked(shapes) == [(bar, 0, None, None, 2), (own, 0, None, None, 2), ("line", 0, 7.0, None, 2)]
    with pytest.raises(ValueError, match="shape"):
        indent_many(coarse, ["bar:1", "bar:2"], [0, 0, 0], doi_mm=0.1)


def test_a_press_that_is_refused_among_many_is_a_row_with_its_reason(coarse: Fingertip) -> None:
    found = indent_many(
        coarse,
        ["bar:1", "bat:1", "bar:1", "bar:1", "bar:1"],
        [0, 0, 99, 0, 0],
        doi_mm=[0.1, 0.1, 0.1, 9, 0.1],
        force_gwt=[np.nan] * 4 + [2],
    )
    assert [result is None for result in found] == [False, True, True, True, True]
    assert [answer.code for answer in found.answers] == ["", "no_such", "x_outside", "doi_outside", "not_one_target"]
    assert [bool(problem) for problem in found.problems] == [False, True, True, True, True]
    assert found.results == list(found)
    assert found.table()["regions"].tolist()[1:] == [0] * 4
    table = found.table()
    assert np.isnan(table["force_gwt"]).tolist() == [False, True, True, True, True]
    assert table["problem"].tolist() == found.problems
    assert found.receptor_table()["indentation"].tolist() == [0, 0]


def test_a_press_that_does_not_converge_among_many_has_result_and_problem(
    coarse: Fingertip, monkeypatch: pytest.MonkeyPatch
) -> None:
    right = coarse.indent("bar:1", doi_mm=0.1)
    wrong = replace(right, state=replace(right.state, residual=2e-5))
    monkeypatch.setattr(Fingertip, "indent", lambda *_, **__: wrong)
    found = indent_many(coarse, "bar:1", doi_mm=0.1)
    assert found[0] is wrong
    assert [answer.code for answer in found.answers] == ["not_converged"]
    assert found.problems != [""]


def test_many_presses_without_target_or_cores_are_refused_before_any_press(coarse: Fingertip) -> None:
    with raises(ArgumentError, "no_target"):
        indent_many(coarse, "bar:1")
    with raises(ArgumentError, "no_cores", cores=0):
        indent_many(coarse, "bar:1", doi_mm=0.1, cores=0)
    empty = indent_many(coarse, "bar:1", [], doi_mm=0.1)
    assert len(empty) == 0
    assert {
        name: len(values) for name, values in (empty.table() | empty.receptor_table()).items() if len(values)
    } == {}


def test_a_lost_worker_process_is_reported(coarse: Fingertip, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(many_indentations, "here_and_in_processes", lambda *_: in_processes(os._exit, [3], 1))
    with raises(WorkerLostError, "worker_lost"):
        indent_many(coarse, "bar:1", [0, 1], doi_mm=0.1, cores=2)


# --- tables ---


def test_the_table_of_many_presses_holds_request_and_result(mixed: Indentations) -> None:
    table = mixed.table()
    assert {len(values) for values in table.values()} == {8}
    assert table["shape"].tolist() == MIXED["shapes"]
    assert table["z_mm"][[0, 5]] == pytest.approx([6.893, 7.0])
    assert np.array_equal(table["asked_doi_mm"], MIXED["doi_mm"], equal_nan=True)  # type: ignore[call-overload]
    assert np.array_equal(table["asked_force_gwt"], MIXED["force_gwt"], equal_nan=True)  # type: ignore[call-overload]
    first = mixed[3]
    assert first is not None
    for name in ("doi_mm", "force_n", "force_gwt", "peak_pressure_kpa", "contact_area_mm2"):
        assert table[name][3] == getattr(first, name)
    assert table["regions"][3] == len(first.contact_regions_mm)
    assert table["residual"][3] == first.state.residual
    receptors = mixed.receptor_table()
    assert list(receptors) == ["indentation", "receptor_x_mm", "receptor_depth_mm", *MEASURES]
    assert receptors["indentation"].tolist() == [row for row in range(8) for _ in range(2)]
    assert receptors["sed"][6:8].tolist() == first.receptor_measures["sed"].tolist()
    assert receptors["receptor_x_mm"][:2] == pytest.approx([0.0, 0.5])
    own = Indentations(
        (IndentationRequest(Bar(2.0), 0.0, None, 0.1, None),), (IndentationOutcome(None, "not asked"),)
    )
    assert own.table()["shape"].tolist() == ["bar:2"]


def test_write_csv_writes_columns_of_equal_length(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    write_csv(path, {"shape": np.array(["bar:3", 'profile:a,"b"']), "force_gwt": np.array([0.1, np.nan])})
    assert path.read_bytes() == b'shape,force_gwt\r\nbar:3,0.1\r\n"profile:a,""b""",nan\r\n'
    with pytest.raises(ValueError, match="zip"):
        write_csv(path, {"shape": np.zeros(1), "force_gwt": np.zeros(2)})


def test_to_xarray_turns_columns_into_a_data_set(
    mixed: Indentations, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "xarray.py").write_text("def Dataset(variables, coords):\n    return variables, coords\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "xarray", raising=False)
    variables, coords = to_xarray(mixed.table())
    monkeypatch.delitem(sys.modules, "xarray")
    assert {dimension for dimension, _ in variables.values()} == {"row"}
    assert variables["shape"][1].tolist() == MIXED["shapes"]
    assert coords["row"].tolist() == list(range(8))


@pytest.mark.parametrize(("convert", "package"), [(to_pandas, "pandas"), (to_xarray, "xarray")])
def test_converting_without_pandas_or_xarray_names_the_package(
    convert: Any, package: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with raises(NotInstalledError, "not_installed", package=package):
        convert({})


FORKED = """
import multiprocessing, pickle, sys
from functools import partial

def force_n(finger, doi_mm):
    return finger.indent("bar:1", doi_mm=doi_mm).force_n

if __name__ == "__main__":
    finger = pickle.loads(open(sys.argv[1], "rb").read())
    depths = [0.1, 0.2, 0.3]
    here = [force_n(finger, doi_mm) for doi_mm in depths]
    for way in ("fork", "spawn"):
        with multiprocessing.get_context(way).Pool(1) as pool:
            assert pool.map(partial(force_n, finger), depths) == here, way
"""


@pytest.mark.skipif(sys.platform == "win32", reason="needs fork (POSIX)")
def test_a_pickled_finger_presses_in_forked_and_spawned_processes(coarse: Fingertip, tmp_path: Path) -> None:
    script, sent = tmp_path / "forked.py", tmp_path / "finger"
    script.write_text(FORKED)
    sent.write_bytes(pickle.dumps(coarse))
    subprocess.run([sys.executable, "-W", "ignore", script, sent], check=True)
