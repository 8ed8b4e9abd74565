"""A row of receptors of the whole finger under a named axial shape: what it feels of a press, and reads back."""

from functools import partial

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from sim.coding.bayes import decode_profile
from sim.coding.decoder_results import decoding_errors
from sim.coding.encoding import noise_sd
from sim.coding.operators import centred
from sim.coding.pressure import ContactPressure
from sim.coding.receptor_readings import Readings
from sim.coding.section import SkinLine
from sim.coding.sheet import ROW_ERROR, AxialShape, PressedSkin, ReceptorRow, receptor_row
from sim.config import FingertipConfig
from sim.contact.patch import X, Z
from sim.models.catalogue import load
from sim.models.fingertip import Fingertip
from sim.models.result import IndentationResult
from sim.units import PSEUDO_E_EPIDERMIS
from tests.sim.coarse_mesh import coarse_mesh

Array = NDArray[np.float64]

CONFIG = FingertipConfig(mesh=coarse_mesh(0.2, 0.35, patch_x_mm=3.0, patch_z_mm=2.6))
ENDS = centred(27, 0.2)
PLACES = centred(29, 0.2)
CENTRE = 7.0


@pytest.fixture(scope="module")
def line() -> SkinLine:
    return SkinLine(load("halfspace", CONFIG).surface, CONFIG.receptor_plane_mm, "skin")


@pytest.fixture(scope="module")
def finger(line: SkinLine) -> Fingertip:
    x_mm = line.below(line.angles(PLACES), 0.76)[:, X]
    return load("finger", CONFIG, receptor_x_mm=x_mm.tolist(), cached=False)


@pytest.fixture(scope="module")
def row(finger: Fingertip, line: SkinLine) -> ReceptorRow:
    return ReceptorRow(PressedSkin(CONFIG, finger.model), line, PLACES)


@pytest.fixture(scope="module")
def cylinder(finger: Fingertip) -> IndentationResult:
    return finger.indent("cylinder:6", 0.2, doi_mm=0.6)


def in_plane(row: ReceptorRow, result: IndentationResult) -> ContactPressure:
    """What a press bears on the skin of the receptor plane."""
    patch, across = result.model.patch, result.model.across
    place = row.line.places(patch.x[across])
    outward = row.line.normals(row.line.angles(place)).T
    pressure = PSEUDO_E_EPIDERMIS * result.state.force[:, across] / patch.area_mm2[across]
    inward = -(outward * pressure).sum(axis=0)
    along = outward[1] * pressure[0] - outward[0] * pressure[1]
    return ContactPressure(place, np.gradient(place), inward, along)


def means(row: ReceptorRow, pressed: IndentationResult) -> Array:
    return in_plane(row, pressed).means(0.5 * (ENDS[1:] + ENDS[:-1]))


def test_the_shape_is_an_ellipse_by_its_name() -> None:
    shape = AxialShape(1.5, CENTRE)
    assert shape.name == "ellipse:1.5"
    assert_allclose(shape.at(np.array([5.5, 6.1, 7.0, 7.9, 8.5, 9.0, 4.0])), [0, 0.8, 1, 0.8, 0, 0, 0], atol=1e-12)


def test_pressures_of_a_press_give_its_sed_under_the_right_length_only(
    row: ReceptorRow, cylinder: IndentationResult
) -> None:
    true, sed = means(row, cylinder), cylinder.receptor_measures["sed"]
    under = {half: row.under(AxialShape(half, CENTRE), ENDS, "finite").sed(true) for half in (1.0, 2.0)}
    missed = {half: np.linalg.norm(found - sed) / np.linalg.norm(sed) for half, found in under.items()}
    assert missed[2.0] < 0.08
    assert missed[1.0] > 3 * missed[2.0]


def test_pressures_are_those_of_the_receptor_plane_wherever_the_shape_is_highest(row: ReceptorRow) -> None:
    plane = np.array(CONFIG.receptor_plane_mm)
    told = {centre: AxialShape(2.0, centre) for centre in (float(plane), float(plane) + 0.8)}
    there, beyond = (row.under(shape, ENDS, "finite") for shape in told.values())
    beside = told[float(plane) + 0.8]
    assert_allclose(beside.at(plane), np.sqrt(1 - 0.4**2))
    assert_allclose(
        beside.over(float(plane), plane + np.array([0.0, 0.8, 2.0])),
        [1, 1 / np.sqrt(1 - 0.4**2), 0.8 / beside.at(plane)],
    )
    even = np.full(26, 100.0)
    under_it = 14  # the receptor below the middle feels what is borne about the plane, which is told to be alike
    assert beyond.sed(even)[under_it] == pytest.approx(there.sed(even)[under_it], rel=0.25)


def test_the_skin_of_the_plane_lies_on_the_cylinder(row: ReceptorRow, cylinder: IndentationResult) -> None:
    true = means(row, cylinder)
    skin = row.under(AxialShape(1.5, CENTRE), ENDS, "finite").skin
    x, y = skin.pressed(true, skin.lean(true) * true)
    inside = np.flatnonzero(true > 0.3 * true.max())[1:]
    centre = cylinder.touch_height_mm - cylinder.doi_mm + 3.0
    assert_allclose(np.hypot(x[inside] - 0.2, y[inside] - centre), 3.0, atol=0.05)


def test_forces_of_a_prismatic_indentor_have_no_part_along_the_finger(row: ReceptorRow) -> None:
    flat = row.under(AxialShape(1.5, CENTRE), ENDS, "finite")
    assert flat.skin.moved_mm.shape == (2, 27, 52)
    assert flat.parts.shape == flat.lateral.shape == (7, 29, 26)
    assert_allclose(flat.place_mm, 0.5 * (ENDS[1:] + ENDS[:-1]))
    assert_allclose(flat.receptor_mm, PLACES)


def test_a_cylinder_is_read_back_under_the_length_that_explains_it_best(
    row: ReceptorRow, cylinder: IndentationResult
) -> None:
    true, sed = means(row, cylinder), cylinder.receptor_measures["sed"]
    sd = noise_sd(sed, 30.0)
    said = Readings.of_sed(sed + sd * np.random.default_rng(1).normal(size=len(sed)), sd)
    shapes = [AxialShape(half, CENTRE) for half in (1.5, 2.5)]
    right, wrong = (decode_profile(operator, said, ROW_ERROR) for operator in row.under_each(shapes, ENDS, "finite"))
    assert decoding_errors(true, right.pressure).relative_l2 < 0.25
    assert wrong.misfit > 1.4 * right.misfit
    low, high = right.band()
    inside = true > 0.05 * true.max()
    assert ((low <= true) & (true <= high))[inside].mean() > 0.7


def test_of_several_shapes_each_is_as_it_is_alone(row: ReceptorRow) -> None:
    shapes = [AxialShape(half, CENTRE) for half in (1.5, 2.5)]
    for shape, operator in zip(shapes, row.under_each(shapes, ENDS, "finite"), strict=True):
        alone = row.under(shape, ENDS, "finite")
        assert_allclose(operator.parts, alone.parts)
        assert_allclose(operator.lateral, alone.lateral)
        assert_allclose(operator.skin.moved_mm, alone.skin.moved_mm)


def test_the_skin_moves_as_its_nodes_do(row: ReceptorRow) -> None:
    """Mixtures of few nodes, by rows of the compliance; against all of it."""
    patch, felt = row.skin.model.patch, row.skin
    rng = np.random.default_rng(0)
    direction, share, seen = rng.normal(size=(3, len(patch))), rng.random((len(patch), 2)), np.zeros((len(patch), 2))
    seen[[3, 40, 41], [0, 1, 1]] = (1.0, 0.25, 0.75)
    force = direction[[0, 1]][:, :, None] * (patch.area_mm2[:, None] * share) / PSEUDO_E_EPIDERMIS
    moved = (patch.compliance @ force.reshape(-1, 2)).reshape(2, len(patch), 2)
    expected = np.stack([moved[:, 3], 0.25 * moved[:, 40] + 0.75 * moved[:, 41]], axis=1)
    found = felt.moved(direction, share, seen)
    assert_allclose(found[:2], expected)
    assert not found[2].any()


@pytest.mark.parametrize("depth_mm", [0.7, (0.6, 0.7, 0.8)])
def test_it_lies_below_places_of_the_receptor_plane(
    tmp_path: object, monkeypatch: pytest.MonkeyPatch, depth_mm: float | tuple[float, ...]
) -> None:
    monkeypatch.setenv("RIG_CACHE_DIR", str(tmp_path))
    config = FingertipConfig(mesh=coarse_mesh(0.6, 0.6, patch_x_mm=2.0, patch_z_mm=1.5))
    row = receptor_row(
        config, np.array([-1.0, 0.0, 1.0]), depth_mm if isinstance(depth_mm, float) else np.array(depth_mm)
    )
    points = row.skin.model.receptors.position_mm
    assert_allclose(points[:, Z], config.receptor_plane_mm)
    deep = np.broadcast_to(depth_mm, 3).tolist()
    above = [row.line.above(x, depth) for x, depth in zip(points[:, X], deep, strict=True)]
    assert_allclose(above, [-1, 0, 1], atol=1e-3)
    assert row.skin.model.patch.axes == (X, 1)


def test_what_a_press_bears_in_the_plane_is_its_forces_there(row: ReceptorRow, cylinder: IndentationResult) -> None:
    borne = in_plane(row, cylinder)
    assert isinstance(borne, ContactPressure)
    pressure = cylinder.nodal_pressure_pseudo[cylinder.model.across]
    assert_allclose(np.hypot(borne.normal, borne.lateral), pressure, atol=1e-6)
    assert (borne.normal >= 0).all()
    assert (np.diff(borne.place_mm) > 0).all()
    total = partial(np.sum, borne.normal * borne.width_mm)
    assert means(row, cylinder).sum() * 0.2 == pytest.approx(float(total()), rel=0.02)
