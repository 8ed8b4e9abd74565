"""Pressures over x and z: what presses bear gives their SED back, is read back from it, and tells what pressed."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from sim.coding.decoder_results import DecodingError, decoding_errors
from sim.coding.encoding import noise_sd
from sim.coding.operators import at_receptors, centred
from sim.coding.receptor_readings import Readings
from sim.coding.section import sed_of
from sim.coding.shape_class import SOLIDS, classify_solid, contact, extent_mm
from sim.coding.sheet import (
    Grid,
    PressedSkin,
    SheetOperator,
    SkinOver,
    decode_sheet,
    sheet_operator,
)
from sim.config import FingertipConfig
from sim.contact.patch import X, Z
from sim.errors import ModelRangeError
from sim.measures.measures import Elastic, measures_from_strain
from sim.models.catalogue import load
from sim.models.fingertip import Fingertip
from sim.models.result import IndentationResult
from tests.error_codes import raises
from tests.sim.coarse_mesh import coarse_mesh

Array = NDArray[np.float64]

CONFIG = FingertipConfig(mesh=coarse_mesh(0.3, 0.3, patch_x_mm=2.5, patch_z_mm=2.5, round_patch_mm=2.5))
PLANE = CONFIG.receptor_plane_mm
SIDE = centred(9, 0.5)
GRID = Grid(centred(13, 0.3), PLANE + centred(13, 0.3))


@pytest.fixture(scope="module")
def finger() -> Fingertip:
    """What is pressed, with a sheet of 81 receptors."""
    return load(
        "finger",
        CONFIG,
        slopes=(X, Z),
        receptor_x_mm=SIDE.tolist(),
        receptor_z_mm=(PLANE + SIDE).tolist(),
        cached=False,
    )


@pytest.fixture(scope="module")
def felt(finger: Fingertip) -> PressedSkin:
    return PressedSkin(CONFIG, finger.model_for((X, Z)))


@pytest.fixture(scope="module")
def operator(felt: PressedSkin) -> SheetOperator:
    return sheet_operator(felt, GRID, "finite")


@pytest.fixture(scope="module")
def sphere(finger: Fingertip) -> IndentationResult:
    return finger.indent("sphere:2", 0.2, z_mm=PLANE + 0.2, doi_mm=0.5)


def forces(pressed: IndentationResult) -> Array:
    """(3, k) of a press on the patch."""
    force = np.zeros((3, len(pressed.model.patch)))
    force[list(pressed.model.patch.axes)] = pressed.state.force
    return force


def borne(felt: PressedSkin, pressed: IndentationResult) -> Array:
    """Normal pressures at the grid's places."""
    patch = pressed.model.patch
    _, outward, _ = felt.frames(patch.x, patch.position_mm[:, Z])
    inward = -(forces(pressed) * outward).sum(axis=0)
    return GRID.nearest(patch.position_mm, patch.area_mm2, 1e4 * inward / patch.area_mm2)


def missed(found: Array, true: Array) -> float:
    return float(np.linalg.norm(found - true) / np.linalg.norm(true))


# --- energy of six strains ---


@pytest.mark.parametrize("young", [1.0, 18.0])
def test_sed_of_all_six_strains_is_half_of_stress_times_strain(young: float) -> None:
    strain, material = np.random.default_rng(0).normal(size=(4, 6)), Elastic(young, 0.48)
    assert_allclose(sed_of(strain.T, material, "finite"), measures_from_strain(strain, material)["sed"])
    plane = strain.copy()
    plane[:, [2, 4, 5]] = 0
    for energy in ("finite", "incompressible"):
        assert_allclose(sed_of(plane.T, material, energy), sed_of(plane.T[[0, 1, 3]], material, energy))  # type: ignore[arg-type]
    apart = sed_of(strain.T, material, "finite") - sed_of(strain.T, material, "incompressible")
    lame = young * 0.48 / (1.48 * 0.04)
    assert_allclose(apart, 0.5 * lame * strain[:, :3].sum(axis=1) ** 2)


# --- places ---


# --- the operator ---


def test_sheet_pressures_normal_to_the_pressed_skin_give_the_sed_of_a_press(
    felt: PressedSkin, operator: SheetOperator, sphere: IndentationResult
) -> None:
    true, sed = borne(felt, sphere), sphere.receptor_measures["sed"]
    assert missed(operator.sed(true), sed) < 0.03
    upright = operator.leaning(np.zeros(169))
    assert missed(upright.sed(true), sed) > 0.06


def test_the_pressed_skin_of_a_sheet_lies_on_the_sphere(
    felt: PressedSkin, operator: SheetOperator, sphere: IndentationResult
) -> None:
    true = borne(felt, sphere)
    at = operator.skin.pressed(true, operator.skin.lean(true))[:, contact(operator.skin, true)]
    centre = np.array([0.2, sphere.touch_height_mm - sphere.doi_mm + 2.0, PLANE + 0.2])
    assert_allclose(np.linalg.norm(at.T - centre, axis=1), 2.0, atol=0.02)


def test_slope_and_gradient_of_a_sheet_operator_are_derivatives_of_its_sed(operator: SheetOperator) -> None:
    """With leans held."""
    rng = np.random.default_rng(3)
    pressure, step = rng.uniform(0, 100, 169), rng.normal(size=169)
    held = operator.leaning(pressure)
    by_difference = (held.sed(pressure + 1e-3 * step) - held.sed(pressure - 1e-3 * step)) / 2e-3
    assert_allclose(operator.slope(pressure) @ step, by_difference, rtol=1e-5)
    weight = rng.normal(size=81)
    assert_allclose(operator.pulled_back(pressure, weight), weight @ operator.slope(pressure))
    assert_allclose(operator.sed(pressure), held.sed(pressure))


# --- the decoder ---


@pytest.mark.parametrize(("snr_db", "most"), [(30.0, 0.35), (20.0, 0.5)])
def test_a_sheet_of_readings_is_decoded_to_the_pressed_sphere(
    felt: PressedSkin, operator: SheetOperator, sphere: IndentationResult, snr_db: float, most: float
) -> None:
    true, sed = borne(felt, sphere), sphere.receptor_measures["sed"]
    sd = noise_sd(sed, snr_db)
    found = decode_sheet(
        operator, Readings.of_sed(sed + sd * np.random.default_rng(1).normal(size=81), sd), GRID.shape
    )
    assert found.converged
    assert found.pressure.min() == 0.0
    assert decoding_errors(true, found.pressure).relative_l2 < most
    assert found.pressure.sum() == pytest.approx(true.sum(), rel=0.1)
    low, high = found.band()
    inside = true > 0.05 * true.max()
    assert ((low <= true) & (true <= high))[inside].mean() > 0.85
    felt_as = classify_solid(operator.skin, found.pressure)
    assert felt_as.name == "sphere"
    assert felt_as.size_mm == pytest.approx(4.0, rel=0.25)
    assert_allclose(felt_as.extent_mm, extent_mm(operator.skin, true), atol=0.25)


def test_a_sheet_with_too_few_readings_or_places_beside_the_patch_is_refused(
    felt: PressedSkin, operator: SheetOperator
) -> None:
    with raises(ModelRangeError, "pressure_beside_patch", x_mm=-3.5):
        sheet_operator(felt, Grid(np.array([-3.5, -3.2]), GRID.z_mm), "finite")
    some = np.arange(81) < 8
    with raises(DecodingError, "too_few", readings=8, pressures=169, fewest=9):
        decode_sheet(at_receptors(operator, some), Readings.of_sed(np.ones(8), 0.1), GRID.shape)  # type: ignore[arg-type]


# --- what touches: made-up skins ---


def lying_on(height: Array, noise_mm: float = 1e-4) -> SkinOver:
    """A skin at (13, 13) heights over x and z whatever bears on it."""
    at = np.stack([GRID.place_mm[:, 0], height.ravel(), GRID.place_mm[:, 1]])
    at[1] += noise_mm * np.random.default_rng(0).normal(size=169)
    return SkinOver(GRID, at, np.zeros((3, 169, 507)), np.tile(np.eye(3), (169, 1, 1)))


DISC = (np.hypot(GRID.place_mm[:, 0] - 0.3, GRID.place_mm[:, 1] - PLANE) < 1.3).astype(float)
XX, ZZ = (GRID.place_mm.T[k].reshape(13, 13) for k in (0, 1))


def outline(name: str, size_mm: float) -> Array:
    """Heights of a skin on a sphere or cylinder of a diameter, a flank of half a wavelength, or a flat."""
    radius, along = size_mm / 2, ZZ - PLANE if name == "sphere" else 0.0
    if name in ("sphere", "cylinder"):
        return np.asarray(-np.sqrt(radius**2 - np.minimum(radius**2, (XX - 0.3) ** 2 + along**2)))
    return np.asarray(
        0.25 * (1 - np.cos(np.pi * np.clip((XX + 0.5) / size_mm, 0.0, 1.0))) if name == "step" else 0 * XX
    )


OUTLINES = [
    *((name, diameter, 0.03) for name in ("sphere", "cylinder") for diameter in (3.0, 8.0, 19.0)),
    *(("step", half_wave, 0.1) for half_wave in (1.3, 2.5)),
    ("bar", 2.27, 0.1),  # as wide as uniform pressure of the same spread: √3 of a disc's radius
]


@pytest.mark.parametrize(("name", "size_mm", "within"), OUTLINES)
def test_skin_on_an_outline_is_classified_with_its_size(name: str, size_mm: float, within: float) -> None:
    found = classify_solid(lying_on(outline(name, size_mm)), DISC)
    assert found.name == name
    assert found.size_mm == pytest.approx(size_mm, rel=within)
    assert set(found.cost) == set(SOLIDS)
