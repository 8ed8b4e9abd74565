"""Answers are arrays and numbers: small when pickled, without a model, and the same when they are read back."""

import copy
import pickle
import subprocess
import sys
from collections.abc import Callable
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim.config.fingertip_config import FingertipConfig, Geometry, Tissue
from sim.contact.indentor import ACROSS, BOTH
from sim.measures.measures import MEASURES
from sim.models import sources
from sim.models.catalogue import load
from sim.models.fingertip import Fingertip
from sim.models.processes.recipe import made
from sim.models.results.indentation import IndentationResult
from sim.models.results.point_load import PointLoadResult

Result = IndentationResult | PointLoadResult
LARGEST_BYTES = 100_000
ROUND_SHAPES = ("sphere:2", "cone:60", "flat:1")
SHAPES = ("bar:3", "bar:1.5", "cylinder:3", "cylinder:9", "step:1", "step:3", "step:5", "grating:0.5,1",
          "wedge:60", "profile", "line", *ROUND_SHAPES, "point")  # fmt: skip


@pytest.fixture(scope="session", params=SHAPES)
def result(request: pytest.FixtureRequest, finger: Fingertip, tmp_path_factory: pytest.TempPathFactory) -> Result:
    """An answer of each kind; loading no model of the point load."""
    shape = request.param
    if shape == "point":
        return finger.point_load(0.5, 3.0)
    if shape == "profile":
        path = tmp_path_factory.mktemp("profile") / "bump.csv"
        path.write_text("x_mm,height_mm\n-2,0.5\n0,0\n2,0.5\n")
        shape = f"profile:{path}"
    x_mm = 0.0 if shape == "line" else -0.3
    return finger.indent(shape, x_mm, z_mm=7.2 if shape in (*ROUND_SHAPES, "line") else None, doi_mm=0.33)


def _public(thing: object) -> dict[str, Any]:
    """What is read from an answer without arguments, methods included."""
    names = [name for name in dir(thing) if not name.startswith("_")]
    values = {name: getattr(thing, name) for name in names}
    return {name: value() if callable(value) else value for name, value in values.items()}


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and np.array_equal(one, other)
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(_same(one[key], other[key]) for key in one)
    if isinstance(one, list | tuple):
        return len(one) == len(other) and all(map(_same, one, other))
    if is_dataclass(one):
        return type(one) is type(other) and all(
            _same(getattr(one, f.name), getattr(other, f.name)) for f in fields(one) if f.name != "_strain"
        )
    return bool(one == other)


def test_an_answer_is_the_same_when_read_back(result: Result) -> None:
    before = _public(pickle.loads(pickle.dumps(result)))
    now = _public(result)
    assert before.keys() == now.keys()
    assert not [name for name in now if not _same(now[name], before[name])]
    assert {"receptor_strain", "receptor_measures", "force_gwt", "as_json", "receptor_table"} <= now.keys()


def test_an_answer_is_small_and_stays_so(result: Result) -> None:
    for _ in range(2):  # the second time with everything looked at
        assert len(pickle.dumps(result)) <= LARGEST_BYTES
        _public(result)
    again = pickle.loads(pickle.dumps(pickle.loads(pickle.dumps(result))))
    assert _same(again.receptor_strain, result.receptor_strain)


def test_many_answers_share_what_they_keep_of_the_model(finger: Fingertip) -> None:
    one, two = (finger.indent("cylinder:9", x, doi_mm=0.2) for x in (0.0, 0.1))
    assert one.model is two.model
    back = pickle.loads(pickle.dumps([one, two]))
    assert back[0].model is back[1].model
    assert len(pickle.dumps([one, two])) < 2 * len(pickle.dumps(one)) - 20_000


def test_contact_alone_computes_no_strain(finger: Fingertip) -> None:
    result = finger.indent("cylinder:9", doi_mm=0.2)
    assert "receptor_strain" not in vars(result)
    assert result.receptor_strain is result.receptor_strain
    assert _same(replace(pickle.loads(pickle.dumps(result)), x_mm=1.0).receptor_strain, result.receptor_strain)


def test_a_press_goes_on_from_an_answer_read_back(finger: Fingertip) -> None:
    result = finger.indent("cylinder:9", doi_mm=0.2)
    live, back = (
        finger.indent("cylinder:9", doi_mm=0.21, start=r.state) for r in (result, pickle.loads(pickle.dumps(result)))
    )
    assert live.force_n == back.force_n
    assert live.state.passes == back.state.passes


def test_reading_an_answer_back_loads_no_finger(finger: Fingertip, tmp_path: Path) -> None:
    path = tmp_path / "result"
    path.write_bytes(pickle.dumps(finger.indent("step:1", -1.63, doi_mm=0.4)))
    code = """if True:
        import pickle, sys
        result = pickle.loads(open(sys.argv[1], "rb").read())
        result.receptor_measures, result.contact_regions_mm, repr(result)
        assert not {"sim.models.fingertip", "sim.models.condensed", "sim.models.cache", "sim.fem.pardiso"} & set(sys.modules)
    """  # noqa: E501
    subprocess.run([sys.executable, "-c", code, path], check=True)


def test_an_answer_names_shape_place_depth_and_force(finger: Fingertip) -> None:
    result = finger.indent("bar:3", 0.5, doi_mm=0.25)
    assert repr(result) == (
        f"<IndentationResult bar:3 at x = 0.5, z = 6.893 mm: 0.25 mm deep, {result.force_gwt:.4g} gwt>"
    )
    assert repr(finger.point_load(0.5, 3)) == "<PointLoadResult at x = 0.5, z = 6.893 mm: 3 gwt>"


def test_receptors_are_a_table(result: Result) -> None:
    table = result.receptor_table()
    assert list(table) == ["x_mm", "depth_mm", *MEASURES]
    assert table["x_mm"].tolist() == pytest.approx([-2, -1.5, -1.25, -1, -0.5, 0, 0.5, 1, 1.5, 2], abs=1e-9)
    assert set(table["depth_mm"]) == {0.76}
    assert _same(table["sed"], result.receptor_measures["sed"])
    table["x_mm"][0] = 9.0
    assert result.receptor_table()["x_mm"][0] == pytest.approx(-2)


# --- fingers ---


@pytest.mark.parametrize("crossed", [lambda f: pickle.loads(pickle.dumps(f)), copy.copy, copy.deepcopy],
                         ids=["pickled", "copied", "deeply copied"])  # fmt: skip
def test_a_finger_crosses(finger: Fingertip, crossed: Callable[[Fingertip], Fingertip]) -> None:
    finger = copy.copy(finger)
    finger.e_epidermis_mpa *= 1.5
    other = crossed(finger)
    assert other is not finger
    assert other.e_epidermis_mpa == finger.e_epidermis_mpa
    assert other.recipe == finger.recipe
    for scene in (("bar:1.5", 0.3, None), ("line", 0.0, 7.0), ("sphere:2", 0.2, 7.0)):
        shape, x, z = scene
        assert (
            other.indent(shape, x, z_mm=z, doi_mm=0.2).force_n == finger.indent(shape, x, z_mm=z, doi_mm=0.2).force_n
        )
    other.e_epidermis_mpa = 1.0
    assert finger.e_epidermis_mpa != 1.0


def test_a_copy_shares_models_and_a_pickle_holds_none(finger: Fingertip) -> None:
    assert copy.deepcopy(finger).model is finger.model
    assert len(pickle.dumps(finger)) < 5000


def test_a_process_to_which_a_finger_is_sent_again_reads_it_once(
    finger: Fingertip, monkeypatch: pytest.MonkeyPatch
) -> None:
    made.cache_clear()
    sent = pickle.dumps(finger)
    first = pickle.loads(sent)
    monkeypatch.setattr(sources, "cached_arrays", None)
    assert pickle.loads(sent).model is first.model
    made.cache_clear()


def test_the_same_receptors_cross(
    coarse_config: FingertipConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And a finger that was built answers as one that was read, to the last bit."""
    monkeypatch.setenv("RIG_CACHE_DIR", str(tmp_path))
    finger = Fingertip.load(coarse_config, receptor_x_mm=[0.25, 0.5], receptor_depth_mm=0.6, slopes=BOTH)
    assert not finger.from_cache
    assert finger.model_for(BOTH).timing_s
    other = pickle.loads(pickle.dumps(finger))
    assert other.model_for(BOTH).receptors.depth_mm == 0.6
    assert other.model_for(BOTH).receptors.position_mm[:, 0] == pytest.approx([0.25, 0.5])
    assert _same(other.point_load(0.1, 2.0).receptor_strain, finger.point_load(0.1, 2.0).receptor_strain)


@pytest.mark.parametrize("name", ["section", "halfspace"])
def test_the_other_models_cross(name: Any, coarse_config: FingertipConfig) -> None:
    model = load(name, coarse_config)
    other = pickle.loads(pickle.dumps(model))
    one, two = (m.indent("cylinder:9", doi_mm=0.1) for m in (model, other))
    assert one.model.kind == two.model.kind == name
    assert one.force_n == pytest.approx(two.force_n, rel=1e-12)
    assert repr(other).startswith(f"<Fingertip {name}, FingertipConfig(mesh=MeshSpec(spacing_mm=0.5, ")


def test_a_config_tells_what_differs_from_the_defaults() -> None:
    assert repr(FingertipConfig()) == "FingertipConfig()"
    config = FingertipConfig(tissue=Tissue(epidermis_mm=0.3), receptor_plane_from_tip_mm=6)
    assert repr(config) == "FingertipConfig(tissue=Tissue(epidermis_mm=0.3), receptor_plane_from_tip_mm=6.0)"
    rows = tuple((z, 4.0, 4.0, 0.0) for z in (0.0, 3.0, 6.0, 9.0, 12.75))
    assert repr(Geometry(sections=rows)) == "Geometry(sections=<5 rows>)"


def test_axes_are_kept(finger: Fingertip) -> None:
    assert finger.indent("line", z_mm=7.0, doi_mm=0.1).model.patch.axes[:-1] == ACROSS
