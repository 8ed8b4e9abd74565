"""Answers are arrays and numbers: small when pickled, without a model, and the same when they are read back."""

import copy
import pickle
import subprocess
import sys
from collections.abc import Callable
from dataclasses import fields, is_dataclass, replace
from functools import partial
from inspect import signature
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim.config import FingertipConfig
from sim.contact.indentor import ALONG, BOTH
from sim.contact.patch import PatchNodes, Y
from sim.contact.points import ContactPoints
from sim.contact.shapes import parse_shape
from sim.contact.solver import ContactState
from sim.measures.measures import MEASURES
from sim.measures.receptors import ReceptorSet
from sim.models.catalogue import load
from sim.models.fingertip import Fingertip
from sim.models.pictures import ModelOutline
from sim.models.result import IndentationResult, PointLoadResult

Result = IndentationResult | PointLoadResult
LARGEST_BYTES = 100_000
ROUND_SHAPES = ("sphere:2",)
SHAPES = ("bar:3", "grating:0.5,1", "profile", "line", *ROUND_SHAPES, "point")


@pytest.fixture(scope="session", params=SHAPES)
def result(
    request: pytest.FixtureRequest,
    finger: Fingertip,
    coarse_finger: Fingertip,
    tmp_path_factory: pytest.TempPathFactory,
) -> Result:
    """An answer of each kind: of shapes along the finger and of a point load on the default finger."""
    shape = request.param
    if shape == "point":
        return finger.point_load(0.5, 3.0)
    if shape == "profile":
        path = tmp_path_factory.mktemp("profile") / "bump.csv"
        path.write_text("x_mm,height_mm\n-2,0.5\n0,0\n2,0.5\n")
        shape = f"profile:{path}"
    if shape in (*ROUND_SHAPES, "line"):
        return coarse_finger.indent(shape, 0.0 if shape == "line" else -0.3, z_mm=7.2, doi_mm=0.33)
    return finger.indent(shape, -0.3, doi_mm=0.33)


def _public(thing: object) -> dict[str, Any]:
    """What is read from an answer without arguments, methods included."""
    names = [name for name in dir(thing) if not name.startswith("_")]
    values = {name: getattr(thing, name) for name in names}
    return {
        name: value() if callable(value) else value
        for name, value in values.items()
        if not (callable(value) and signature(value).parameters)
    }


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


def test_a_pickled_result_reads_back_the_same(result: Result) -> None:
    before = _public(pickle.loads(pickle.dumps(result)))
    now = _public(result)
    assert before.keys() == now.keys()
    assert not [name for name in now if not _same(now[name], before[name])]
    assert {"receptor_strain", "receptor_measures", "force_gwt", "as_json", "receptor_table"} <= now.keys()


def test_a_pickled_result_stays_small(result: Result) -> None:
    for _ in range(2):  # the second time with everything looked at
        assert len(pickle.dumps(result)) <= LARGEST_BYTES
        _public(result)
    again = pickle.loads(pickle.dumps(pickle.loads(pickle.dumps(result))))
    assert _same(again.receptor_strain, result.receptor_strain)


def test_a_press_continues_from_a_pickled_result(finger: Fingertip) -> None:
    result = finger.indent("cylinder:9", doi_mm=0.2)
    live, back = (
        finger.indent("cylinder:9", doi_mm=0.21, start=r.state) for r in (result, pickle.loads(pickle.dumps(result)))
    )
    assert live.force_n == back.force_n
    assert live.state.passes == back.state.passes


def test_reading_a_pickled_result_loads_no_finger(finger: Fingertip, tmp_path: Path) -> None:
    path = tmp_path / "result"
    path.write_bytes(pickle.dumps(finger.indent("step:1", -1.63, doi_mm=0.4)))
    code = """if True:
        import pickle, sys
        result = pickle.loads(open(sys.argv[1], "rb").read())
        result.receptor_measures, result.contact_regions_mm, repr(result)
        assert not {"sim.models.fingertip", "sim.models.condensed", "sim.models.cache", "sim.fem.dissection"} & set(sys.modules)
    """  # noqa: E501
    subprocess.run([sys.executable, "-c", code, path], check=True)


def test_the_receptor_table_has_place_depth_and_all_measures(result: Result) -> None:
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
def test_a_pickled_finger_presses_the_same(
    coarse_config: FingertipConfig, crossed: Callable[[Fingertip], Fingertip]
) -> None:
    finger = Fingertip.load(coarse_config)
    finger.e_epidermis_mpa *= 1.5
    other = crossed(finger)
    assert other is not finger
    assert other.e_epidermis_mpa == finger.e_epidermis_mpa
    assert other.recipe == finger.recipe
    for shape, x, z in (("bar:1.5", 0.3, None), ("line", 0.0, 7.0), ("sphere:2", 0.2, 7.0)):
        here, there = (one.indent(shape, x, z_mm=z, doi_mm=0.1).force_n for one in (finger, other))
        assert here == there
    other.e_epidermis_mpa = 1.0
    assert finger.e_epidermis_mpa != 1.0


def test_a_pickled_finger_keeps_its_receptors(
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
def test_a_pickled_section_or_half_space_presses_the_same(name: Any, coarse_config: FingertipConfig) -> None:
    model = load(name, coarse_config)
    other = pickle.loads(pickle.dumps(model))
    one, two = (m.indent("cylinder:9", doi_mm=0.1) for m in (model, other))
    assert one.model.kind == two.model.kind == name
    assert one.force_n == pytest.approx(two.force_n, rel=1e-12)
    assert repr(other).startswith(f"<Fingertip {name}, FingertipConfig(mesh=MeshSpec(spacing_mm=0.5, ")


# --- what is read from an answer made by hand: three rows of six nodes with forces where they are wanted ---

SIDE = np.array([-1.0, -0.5, 0.0, 0.25, 0.75, 1.5])  # x of the columns, from right to left in the patch
ALONG_MM = np.array([5.0, 6.0, 7.0])
ROW = 1  # the receptor plane


def _outline(axes: tuple[int, ...] = ALONG) -> ModelOutline:
    z, x = (v.ravel() for v in np.meshgrid(ALONG_MM, SIDE[::-1], indexing="ij"))
    patch = PatchNodes(np.stack([x, 4.0 - 0.1 * x * x, z], axis=1), np.linspace(0.1, 0.27, 18), (3, 6), (*axes, Y))
    receptors = ReceptorSet(np.array([[-0.5, 3.2, 6.0], [0.5, 3.2, 6.0]]), np.full(2, 0.8))
    return ModelOutline(patch, np.arange(18) + 40, ROW, receptors, np.array([0.1, 1.0]), 1234, "finger", 0.48, True)


def _node(x_mm: float, row: int = ROW) -> int:
    return 6 * row + int(np.flatnonzero(SIDE[::-1] == x_mm)[0])


def _by_hand(bearing: dict[int, float], shape: str = "bar:3", axes: tuple[int, ...] = ALONG) -> IndentationResult:
    """Under a bar at x = 0 and 0.5 mm deep; places are pushed down by 0.01 mm a node and aside by 0.001."""
    number, force = np.arange(18.0), np.zeros((2, 18))
    for node, newton in bearing.items():
        force[:, node] = 0.75 * newton, -newton
    points = ContactPoints(np.array(sorted(bearing), dtype=np.int64), np.zeros(0, np.int64))
    multiplier = -force[1, points.nodes]
    gap = np.where(force[1] != 0, 0.0, 0.2)
    state = ContactState(points, multiplier, np.stack([0.001 * number, -0.01 * number]), force, gap, 2e-11, 7)
    strain = partial(np.arange, 12.0)
    return IndentationResult(
        parse_shape(shape), 0.125, 6.25, 0.5, 4.25, 0.02, state, _outline(axes), 0.2, 0.003,
        lambda: 1e-3 * strain().reshape(2, 6),
    )  # fmt: skip


FEW = {_node(-0.5): 0.3, _node(0.25): 0.1, _node(0.75): 0.2, _node(0.0, row=2): 0.4}


def test_force_area_and_peak_pressure_of_a_result_follow_from_nodal_forces() -> None:
    result = _by_hand(FEW)
    area = result.model.patch.area_mm2
    assert result.force_gwt == pytest.approx(0.02 / 9.80665e-3)
    assert result.contact_area_mm2 == pytest.approx(sum(area[node] for node in FEW))
    pressure = {node: 1e4 * 1.25 * newton / area[node] for node, newton in FEW.items()}  # 0.75 and 1 make 1.25
    assert result.peak_pressure_pseudo == pytest.approx(max(pressure.values()))
    assert result.peak_pressure_mpa == pytest.approx(max(pressure.values()) * 0.2 / 1e4)
    assert result.peak_pressure_kpa == pytest.approx(max(pressure.values()) * 200 / 1e4)
    assert result.nodal_pressure_pseudo == pytest.approx(np.array([pressure.get(node, 0.0) for node in range(18)]))
    assert _by_hand({node: 2 * newton for node, newton in FEW.items()}).contact_area_mm2 == result.contact_area_mm2


def test_the_profiles_of_a_result_lie_in_the_receptor_plane() -> None:
    result = _by_hand(FEW)
    nodes = [_node(x) for x in SIDE]
    assert result.plane == slice(6, 12)
    assert result.model.across.tolist() == nodes
    assert result.model.plane_mm == 6.0
    x, pressure = result.pressure_profile
    assert x.tolist() == SIDE.tolist()
    assert pressure.tolist() == result.nodal_pressure_pseudo[nodes].tolist()
    x, y = result.skin_profile
    assert x == pytest.approx(SIDE + 0.001 * np.array(nodes))
    assert y == pytest.approx(4.0 - 0.1 * SIDE**2 - 0.01 * np.array(nodes))
    z, down = result.axial_profile
    assert z.tolist() == ALONG_MM.tolist()
    assert down == pytest.approx(0.01 * np.array([_node(0.0, row) for row in range(3)]))


@pytest.mark.parametrize(
    ("touching", "regions"),
    [
        ([], []),
        ([-0.5], [(-0.5, -0.5)]),
        ([-0.5, 0.75], [(-0.5, -0.5), (0.75, 0.75)]),
        ([0.0, 0.25], [(0.0, 0.25)]),  # 0.25 mm apart is together, 0.5 is not
        ([-1.0, 0.0, 0.25, 0.75], [(-1.0, -1.0), (0.0, 0.25), (0.75, 0.75)]),
    ],
)
def test_contact_regions_end_at_the_last_touching_node_under_a_corner(
    touching: list[float], regions: list[tuple[float, float]]
) -> None:
    assert _by_hand({_node(x): 0.1 for x in touching}).contact_regions_mm == regions


def _opening(gap_mm: dict[float, float]) -> list[tuple[float, float]]:
    """Regions under a cylinder that bears from x = 0 to 0.25, with gaps in the receptor plane."""
    result = _by_hand({_node(0.0): 0.1, _node(0.25): 0.1}, "cylinder:9")
    gap = result.state.gap.copy()
    for x, height in gap_mm.items():
        gap[_node(x)] = height
    return replace(result, state=replace(result.state, gap=gap)).contact_regions_mm


def test_contact_regions_end_between_nodes_under_a_smooth_shape() -> None:
    """gap ∝ (x − end)^1.5, so that gap^(2/3) is a line: from 0.04 at 0.75 to 0.16 at 1.5 it is 0 at 0.5."""
    ((low, high),) = _opening({-1.0: 0.16**1.5, -0.5: 0.04**1.5, 0.75: 0.04**1.5, 1.5: 0.16**1.5})
    assert high == pytest.approx(0.75 - 0.75 * 0.04 / 0.12)
    assert low == pytest.approx(-0.5 + 0.5 * 0.04 / 0.12)
