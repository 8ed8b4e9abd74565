"""A row of receptors of the whole finger under a named axial shape: what it feels of a press, and reads back."""

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
from sim.coding.sheet import ROW_ERROR, AxialShape, PressedSkin, ReceptorRow
from sim.config import FingertipConfig
from sim.contact.patch import X
from sim.models.catalogue import load
from sim.models.fingertip import Fingertip
from sim.models.result import IndentationResult
from sim.units import PSEUDO_E_EPIDERMIS
from tests.sim.coarse_mesh import coarse_mesh

Array = NDArray[np.float64]

CONFIG = FingertipConfig(mesh=coarse_mesh(0.25, 0.4, patch_x_mm=3.0, patch_z_mm=2.6))
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


def test_the_axial_shape_ellipse_has_an_elliptic_profile() -> None:
    shape = AxialShape(1.5, CENTRE)
    assert shape.name == "ellipse:1.5"
    assert_allclose(shape.at(np.array([5.5, 6.1, 7.0, 7.9, 8.5, 9.0, 4.0])), [0, 0.8, 1, 0.8, 0, 0, 0], atol=1e-12)


def test_contact_pressures_reproduce_the_sed_under_the_right_contact_length_only(
    row: ReceptorRow, cylinder: IndentationResult
) -> None:
    true, sed = means(row, cylinder), cylinder.receptor_measures["sed"]
    under = {half: row.under(AxialShape(half, CENTRE), ENDS, "finite").sed(true) for half in (1.0, 2.0)}
    missed = {half: np.linalg.norm(found - sed) / np.linalg.norm(sed) for half, found in under.items()}
    assert missed[2.0] < 0.08
    assert missed[1.0] > 3 * missed[2.0]


def test_the_pressed_skin_lies_on_the_cylinder(row: ReceptorRow, cylinder: IndentationResult) -> None:
    true = means(row, cylinder)
    skin = row.under(AxialShape(1.5, CENTRE), ENDS, "finite").skin
    x, y = skin.pressed(true, skin.lean(true) * true)
    inside = np.flatnonzero(true > 0.3 * true.max())[1:]
    centre = cylinder.touch_height_mm - cylinder.doi_mm + 3.0
    assert_allclose(np.hypot(x[inside] - 0.2, y[inside] - centre), 3.0, atol=0.05)


def test_a_pressed_cylinder_is_decoded_under_the_contact_length_that_fits_best(
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
