"""A finger that stiffens: what its quick answers are made of, and that a finger that does not is what it was."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydantic import ValidationError

from rig.plan.config import load_config
from sim.config import FingertipConfig, Tissue
from sim.contact.first_contact import first_touch
from sim.contact.shapes import parse_shape
from sim.errors import ForceOutOfReachError, ModelRangeError
from sim.finger.surface import FingertipSurface
from sim.measures.measures import MEASURES
from sim.models.catalogue import load
from sim.models.fingertip import Fingertip
from sim.models.relaxation import Prony, PronyTerm
from sim.models.result import IndentationResult
from sim.models.stiffening import (
    FORCE,
    LINEAR_TISSUE,
    ROOFS,
    DimensionlessPress,
    Energy,
    ForceFactor,
    Overlap,
    ReceptorPress,
    Squeezed,
    Under,
    force_factor,
    log_force,
    overlap,
    roof,
    squeezed,
    strain_and_stress,
    thickness_mm,
    young_below,
)
from sim.models.viscoelastic import InTime
from tests.error_codes import raises
from tests.sim.coarse_mesh import coarse_mesh

MESH = coarse_mesh(0.4, 0.4, patch_x_mm=2.5, patch_z_mm=2.5, round_patch_mm=2.5)
HUMAN = Path(__file__).parents[2] / "examples" / "human_finger" / "finger.toml"
PRESS = DimensionlessPress(0.25, 1.21, 4.0, 0.5, 0.2, 2.25)


def config(stiffening: float = 0.0) -> FingertipConfig:
    return FingertipConfig(mesh=MESH, tissue=Tissue(stiffening=stiffening) if stiffening else Tissue())


def of_tissue(tissue: Tissue) -> Fingertip:
    """Built once: how tissue stiffens makes no other model."""
    return load("finger", FingertipConfig(mesh=MESH, tissue=tissue))


@pytest.fixture(scope="module")
def linear() -> Fingertip:
    return of_tissue(Tissue())


@pytest.fixture(scope="module")
def stiff() -> Fingertip:
    return of_tissue(Tissue(stiffening=0.4))


# --- the functions ---


def test_the_stiffening_force_law_uses_each_parameter_as_documented() -> None:
    numbers = ForceFactor(0.3, 1.5, 0.5, -0.5, 2.0, 2.0, -0.5, 0.7, 4.0, 3.0, 1.5)
    lost = 0.3 * 1.5 / 2
    squeeze = 2.0 * 0.25**2 / 1.1
    strain = 4.0 * 0.25**3 * np.exp(0.75)
    assert numbers.geometric(PRESS) == pytest.approx(squeeze - lost * np.tanh(0.3 / lost))
    assert numbers.strained(PRESS) == pytest.approx(strain)
    expected = squeeze - lost * np.tanh(0.3 / lost) + 0.7 * np.log(1 + 0.6 * strain)
    assert log_force(numbers, 0.6, PRESS) == pytest.approx(expected)


def test_the_stiffening_energy_law_uses_each_parameter_as_documented() -> None:
    """At λ = 0.8 squeezed tissue has (0.8 − 1.25)² instead of 0.16; the law's strain grows as that of the force."""
    numbers = Energy(2.0, 1.2, 0.4, 0.5, -0.5, 3.0)
    felt = ReceptorPress(np.array([0.2, 0.0]), np.array([0.25, 4.0]), np.array([0.1, 0.02]))
    moved = 0.1 * np.exp(0.25 * (2.0 * 0.8 - 1.2))
    beyond = 0.4 * 0.5 / 1.5 * 0.8 * (0.2025 - 0.16)
    expected = [moved + beyond, 0.02 * np.exp(-0.3)]
    assert_allclose(numbers.geometric(PRESS, felt), expected)
    strain = 3.0 * 0.2025 * np.exp(0.5 * FORCE.strain_confined)
    assert_allclose(numbers.strained(PRESS, felt), [strain, 0.0], atol=1e-15)


def test_force_grows_with_stiffening_and_a_shallow_press_is_linear() -> None:
    factors = [force_factor(a, PRESS) for a in (1e-9, 0.3, 1.0, 3.0)]
    assert (np.diff(factors) > 0).all()
    assert force_factor(0.3, DimensionlessPress(1e-6, 1e-5, 1.2, 0.0, 1e-6, 1.2)) == pytest.approx(1.0, abs=2e-3)


# --- where an indentor overlaps the skin ---


def _parabola(half_mm: float) -> Overlap:
    """A bowl of radii 2 and 8 mm, which an edge ends across."""
    x, z = np.meshgrid(np.linspace(-3, 3, 301), np.linspace(-6, 6, 301))
    gap = np.where(np.abs(x) < half_mm, x**2 / 4 + z**2 / 16, np.inf)
    return Overlap(gap.ravel(), np.stack([x.ravel(), z.ravel()]), np.full(x.size, 0.02 * 0.04))


def test_the_overlap_of_a_bowl_has_its_longer_radius_and_grows_quadratically() -> None:
    bowl = _parabola(9.0)
    assert bowl.long_radius_mm(1.0) == pytest.approx(8.0, rel=1e-3)
    assert bowl.power(1.0) == pytest.approx(2.0, abs=1e-3)
    assert bowl.long_radius_mm(0.01) == bowl.long_radius_mm(0.1)
    assert bowl.power(0.01) == bowl.power(0.1)


def test_the_overlap_past_an_edge_grows_with_the_power_3_2() -> None:
    """Far past an edge the overlap grows as a slice does, by 3/2."""
    assert _parabola(0.3).power(2.0) == pytest.approx(1.5, abs=0.02)
    nothing = Overlap(np.full(4, np.inf), np.zeros((2, 4)), np.full(4, 0.12))
    assert nothing.power(0.5) == 2.0
    assert nothing.long_radius_mm(0.5) == pytest.approx(0.06)


@pytest.mark.parametrize("shape", ["flat", "sphere:3"])
def test_the_overlap_volume_with_the_skin_follows_from_the_radii(skin: FingertipSurface, shape: str) -> None:
    """π √(R₁ R₂) d² under a plate, with 1 / R the sum of the curvatures under a ball."""
    config, indentor = FingertipConfig(), parse_shape(shape)
    apex, doi_mm = skin.apex, 0.3
    place = tuple({0: apex.position_mm[0], 2: apex.position_mm[2]}[axis] for axis in indentor.axes)
    touch = first_touch(indentor, place, skin)
    found = overlap(indentor, place, touch, skin, config.geometry.length_mm).volume_mm3(doi_mm)
    own = 0.0 if shape == "flat" else 1 / 3.0
    curvatures = [1 / r + own for r in (apex.lateral_radius_mm, apex.axial_radius_mm)]
    assert found == pytest.approx(np.pi * doi_mm**2 / np.sqrt(np.prod(curvatures)), rel=0.05)


def test_the_squeeze_at_a_receptor_is_overlap_over_the_thickness_to_the_bone(skin: FingertipSurface) -> None:
    tissue, indentor = Tissue(), parse_shape("flat")
    z = skin.apex.position_mm[2]
    touch = first_touch(indentor, (0.0,), skin)
    at = np.array([[skin.apex.position_mm[0], 4.0, z], [2.5, 3.0, z]])
    found = squeezed(indentor, (0.0,), touch, at, skin, tissue.bone_fraction)
    y = skin.section(skin.angle_at(at[:, 0], at[:, 2]), at[:, 2])[1]
    assert_allclose(found.gap_mm, np.tile((touch.height_mm - y)[:, None], len(found.weight)), atol=1e-9)
    assert found.thickness_mm[0] == pytest.approx(y[0] * (1 - tissue.bone_fraction), rel=0.01)
    assert found.thickness_mm[1] == pytest.approx(y[1])
    two = Squeezed(np.array([[0.1, 0.1], [0.4, 0.6]]), np.array([0.75, 0.25]), np.array([2.0, 4.0]))
    assert_allclose(two.strain(0.5), [0.2, 0.75 * 0.1 / 4])
    assert_allclose(two.strain(50.0), 0.9)


@pytest.mark.parametrize(("x_mm", "under"), [(0.6, 1.0), (1.5, 0.5), (1.8, 0.18), (2.4, 0.0)])
def test_tissue_under_an_indentor_edge_has_half_the_squeeze(
    skin: FingertipSurface, x_mm: float, under: float
) -> None:
    """Of a bar that ends at 1.5 mm, 0.75 mm below the skin: 0.3 mm past its edge (1 − 0.3 / 0.75)² / 2 of it."""
    bar, z = parse_shape("bar:3.0"), skin.apex.position_mm[2]
    touch = first_touch(bar, (0.0,), skin)
    y = float(skin.section(skin.angle_at(x_mm, z), z)[1])
    found = squeezed(bar, (0.0,), touch, np.array([[x_mm, y - 0.75, z]]), skin, Tissue().bone_fraction)
    whole = (1.0 - (touch.height_mm - y)) / found.thickness_mm[0]
    assert found.strain(1.0)[0] == pytest.approx(under * whole, abs=0.05 * whole)


def test_stiffening_measures_a_press_from_first_touch_in_units_of_tissue_thickness(skin: FingertipSurface) -> None:
    told, indentor = config(0.4), parse_shape("flat")
    touch = first_touch(indentor, (0.0,), skin)
    receptor = np.array([[0.0, 4.0, 6.9]])
    under = Under(told, skin, indentor, (0.0,), touch)
    thick = thickness_mm(told, skin)
    assert thick == pytest.approx(0.68 * skin.section(np.pi / 2, told.receptor_plane_mm)[1])
    found = under.at(0.5, receptor)
    assert found.stiffening == 0.4
    assert found.press.depth == pytest.approx(0.5 / thick)
    assert found.press.bend == pytest.approx(0.25 * (1 / skin.apex.lateral_radius_mm + 1 / skin.apex.axial_radius_mm))
    volume = overlap(indentor, (0.0,), touch, skin, 12.75).volume_mm3(0.5)
    assert found.press.width == pytest.approx(volume / (0.5 * thick**2))
    reached = overlap(indentor, (0.0,), touch, skin, 12.75)
    assert found.press.length == pytest.approx(reached.long_radius_mm(0.5) / thick)
    assert found.press.confined == pytest.approx(2 - reached.power(0.5))
    assert found.squeeze[0] == pytest.approx(0.5 / thick, rel=0.02)
    assert found.below == young_below(told.tissue, thick)
    assert under.at(0.0, receptor) is LINEAR_TISSUE
    assert under.at(0.5, np.zeros((0, 3))).squeeze.shape == (0,)
    assert Under(config(), skin, indentor, (0.0,), touch).at(0.5, receptor) is LINEAR_TISSUE


def test_the_stiffness_of_the_skin_over_that_of_the_layers_in_series_is_capped(skin: FingertipSurface) -> None:
    """0.4 mm of 1 over (3 mm: 0.8 of 0.2 and 1.8 of 0.05): series modulus 2.6 / 40."""
    assert roof(Tissue(e_dermis=0.2, e_fat=0.05), 3.0) == pytest.approx(0.4 / (3.0 * 2.6 / 40))
    soft = FingertipConfig(mesh=MESH, tissue=Tissue(e_dermis=0.01, e_fat=0.001, stiffening=0.4))
    touch = first_touch(parse_shape("flat"), (0.0,), skin)
    assert Under(soft, skin, parse_shape("flat"), (0.0,), touch).at(0.5, np.zeros((0, 3))).press.roof == ROOFS[1]


@pytest.mark.parametrize("shape", ["bar:3.0", "sphere:3", "flat:3"])
def test_the_shallowest_presses_of_stiffening_tissue_are_linear(skin: FingertipSurface, shape: str) -> None:
    """Where the overlap is finer than it is sampled, and all the way down to nothing."""
    indentor = parse_shape(shape)
    place = (0.0,) if len(indentor.axes) == 1 else (0.0, 6.9)
    under = Under(config(0.4), skin, indentor, place, first_touch(indentor, place, skin))
    found = [under.at(doi_mm, np.zeros((0, 3))).force for doi_mm in (1e-9, 1e-6, 1e-3, 0.02, 0.03)]
    assert found[0] == pytest.approx(1.0, abs=1e-3)
    assert np.abs(np.diff(found)).max() < 0.05


# --- the finger ---


def test_tissue_without_stiffening_is_the_linear_finger_bit_for_bit(linear: Fingertip) -> None:
    found = linear.indent("cylinder:9", doi_mm=0.5)
    assert found.strained is LINEAR_TISSUE
    assert found.strained.force == 1.0
    assert found.force_n == found.state.normal_force * linear.e_epidermis_mpa
    measures = found.model.measures(found.receptor_strain)
    assert found.strained.measures(measures, found.model.receptor_e, found.model.poisson) is measures


def test_stiffening_scales_force_pressure_and_receptor_measures(linear: Fingertip, stiff: Fingertip) -> None:
    was, now = (finger.indent("cylinder:9", 0.2, doi_mm=0.8) for finger in (linear, stiff))
    factor = now.strained.force
    assert factor == force_factor(0.4, now.strained.press) != 1.0
    assert now.force_n == pytest.approx(was.force_n * factor)
    assert now.peak_pressure_pseudo == pytest.approx(was.peak_pressure_pseudo * factor)
    felt = now.strained.at_receptors(was.receptor_measures["sed"], now.model.receptor_e, now.model.poisson)
    strain, stress = strain_and_stress(0.4, now.strained.press, felt)
    assert len(stress) == len(now.model.receptors.position_mm)
    own = {"sed": strain * stress, "third": stress**3}
    for name in MEASURES:
        wanted = was.receptor_measures[name] * own.get(name, strain if name.startswith("e") else stress)
        assert_allclose(now.receptor_measures[name], wanted)


NOT_STIFFENING = Tissue(strain="finite")
STRAIN_OF = {  # what the user writes, strain and stiffening that result, and why
    "nothing": ({}, ("small", 0.0)),  # the default keeps its numbers
    "a word alone": ({"strain": "finite"}, ("finite", 0.0)),  # tissue that does not stiffen, at finite strain
    "both": ({"strain": "finite", "stiffening": 0.3}, ("finite", 0.3)),
    "a number alone": ({"stiffening": 0.3}, ("finite", 0.3)),  # as before: small strain knows no stiffening
    "zero at small strain": ({"strain": "small", "stiffening": 0.0}, ("small", 0.0)),
    "zero alone": ({"stiffening": 0.0}, None),  # it was the linear model; the limit of small numbers is another
    "a number at small strain": ({"strain": "small", "stiffening": 0.3}, None),
    "every key, of an earlier version": (Tissue().model_dump(exclude={"strain"}), ("small", 0.0)),
    "every key, of an earlier version, stiffening": (
        Tissue(stiffening=0.3).model_dump(exclude={"strain"}),
        ("finite", 0.3),
    ),
}


@pytest.mark.parametrize("written", STRAIN_OF)
def test_the_strain_setting_is_kept_and_an_ambiguous_zero_stiffening_is_refused(written: str) -> None:
    values, expected = STRAIN_OF[written]
    if expected is None:
        with pytest.raises(ValidationError, match="finite"):
            Tissue(**values)
        return
    found = Tissue(**values)
    assert (found.strain, found.stiffening) == expected
    assert Tissue(**found.model_dump()) == found
    assert Tissue.model_validate_json(found.model_dump_json()) == found


@pytest.mark.parametrize("stiffening", [1e-9, 1e-3])
def test_zero_stiffening_is_the_limit_of_small_stiffening(stiffening: float) -> None:
    """Force and energy grow by less than the stiffening: (1 + a κ)^0.58 with κ of about 1 at this depth."""

    def pressed(tissue: Tissue) -> IndentationResult:
        return of_tissue(tissue).indent("cylinder:9", doi_mm=0.7)

    zero, some = pressed(NOT_STIFFENING), pressed(Tissue(stiffening=stiffening))
    assert zero.force_n < some.force_n < zero.force_n * (1 + 2 * stiffening)
    sed, more = (found.receptor_measures["sed"] for found in (zero, some))
    assert_allclose(more, sed, rtol=2 * stiffening)
    assert zero.force_n != pytest.approx(pressed(Tissue()).force_n, rel=0.03)  # the linear model is another
    assert zero.small_strain.note.startswith("finite strain, stiffening 0:")


def test_force_control_on_stiffening_tissue_finds_the_depth(stiff: Fingertip) -> None:
    at_depth = stiff.indent("cylinder:9", 0.2, doi_mm=0.7)
    at_force = stiff.indent("cylinder:9", 0.2, force_gwt=at_depth.force_gwt)
    assert at_force.doi_mm == pytest.approx(0.7, abs=1e-6)
    assert at_force.force_gwt == pytest.approx(at_depth.force_gwt)
    assert at_force.state.converged
    with raises(ForceOutOfReachError, "force_out_of_reach", force_gwt=1e6):
        load("halfspace", config()).indent("sphere:3", force_gwt=1e6)


def test_stiffening_counts_depth_from_first_touch_with_either_reference(stiff: Fingertip) -> None:
    from_touch = stiff.indent("cylinder:3", 1.0, doi_mm=0.4)
    higher = stiff.touch_height_mm("cylinder:3", 1.0, "apex") - stiff.touch_height_mm("cylinder:3", 1.0)
    from_apex = stiff.indent("cylinder:3", 1.0, doi_mm=0.4 + higher, reference="apex")
    assert higher > 0.05
    assert from_apex.force_n == pytest.approx(from_touch.force_n, rel=1e-6)


# --- how deep, and the human-sized finger ---


def test_the_default_finger_may_be_pressed_to_two_millimeters(linear: Fingertip) -> None:
    assert linear.deepest_doi_mm == 2.0
    with raises(ModelRangeError, "doi_outside", doi_mm=2.01, deepest_mm=2.0):
        linear.indent("cylinder:9", doi_mm=2.01)


def test_the_human_sized_finger_may_be_pressed_to_three_millimeters() -> None:
    told = load_config(HUMAN).finger
    surface = FingertipSurface.fit(told.geometry)
    assert Fingertip.deepest_doi_mm.func(_Bare(told, surface)) == 3.0  # type: ignore[attr-defined]
    assert 45 < surface.apex.axial_radius_mm < 51
    assert surface.apex.position_mm[2] == pytest.approx(told.receptor_plane_mm, abs=0.05)
    half_width = surface.section(np.array([0.0]), told.receptor_plane_mm)[0][0]
    assert 16 <= 2 * half_width <= 20


class _Bare:
    def __init__(self, told: FingertipConfig, surface: FingertipSurface) -> None:
        self.config, self.surface = told, surface


# --- and relaxes ---

TERMS = (PronyTerm(0.2, 0.07), PronyTerm(0.2, 1.4))
SERIES = Prony(TERMS)


def test_stiffening_tissue_relaxes_the_force_it_bore_while_softer(stiff: Fingertip) -> None:
    """Growing contact: f = α (k p − c), c being what has relaxed of the shallower press."""
    press, shallow, deep = InTime(stiff, "flat", SERIES), *(stiff.indent("flat", doi_mm=mm) for mm in (0.3, 0.8))
    assert press.to_depth(0.0, 0.3).force_n == pytest.approx(shallow.force_n, rel=1e-6)
    assert press.to_depth(60.0, 0.3).force_n == pytest.approx(0.6 * shallow.force_n, rel=1e-6)
    now = press.to_depth(0.0, 0.8)
    assert now.force_n == pytest.approx(deep.force_n - 0.4 * shallow.force_n, rel=1e-6)
    assert press.strain() == pytest.approx(deep.receptor_strain, abs=1e-7)
    assert deep.strained.force > 1.05 * shallow.strained.force, "it stiffens between the two"
    assert press.to_depth(60.0, 0.8).force_n == pytest.approx(0.6 * deep.force_n, rel=1e-6)
