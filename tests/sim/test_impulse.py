"""Impulse responses of the section: against what incompressibility, symmetry, and the press itself say."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sim.coding.operators import ImpulseResponses, impulse_responses, shift_errors
from sim.coding.section import SampledSection, Sampling, SkinLine, sampled_section, sed_of, squared_parts
from sim.config import FingertipConfig, Geometry, Tissue
from sim.errors import ModelRangeError
from sim.finger.surface import FingertipSurface
from sim.measures.measures import Elastic, measures_from_strain
from sim.units import PSEUDO_E_EPIDERMIS
from tests.error_codes import raises
from tests.sim.coarse_mesh import coarse_mesh

PLANE = FingertipConfig().receptor_plane_mm
COARSE = FingertipConfig(mesh=coarse_mesh(0.3, 0.5))
UPRIGHT = FingertipConfig(
    mesh=COARSE.mesh,
    geometry=Geometry(sections=tuple((z, 4.5, 4.6, 0.0) for z in np.linspace(0.0, 12.75, 5).tolist())),
)


@pytest.fixture(scope="module")
def responses(section: SampledSection) -> ImpulseResponses:
    return impulse_responses(section)


@pytest.fixture(params=["skin", "cartesian"])
def line(request: pytest.FixtureRequest, skin: FingertipSurface) -> SkinLine:
    return SkinLine(skin, PLANE, request.param)


# --- the skin as a line ---


def test_places_along_the_skin_count_by_arc_length_and_cartesian_ones_by_x(skin: FingertipSurface) -> None:
    x = np.linspace(-3.0, 2.0, 200001)
    chord = np.hypot(np.diff(x), np.diff(skin.height(x, PLANE))).sum()  # of so many chords: right to 1e-9
    ends = SkinLine(skin, PLANE, "skin").places(x[[0, -1]])
    assert np.diff(ends)[0] == pytest.approx(chord, rel=1e-7)
    assert_allclose(SkinLine(skin, PLANE, "cartesian").places([-3.0, 2.0]), [-3.0, 2.0])


def test_axes_along_the_skin_rotate_the_strain_and_keep_its_invariants(skin: FingertipSurface) -> None:
    line = SkinLine(skin, PLANE, "skin")
    angle = line.angles([-2.5, 0.0, 3.0])
    strain = np.random.default_rng(1).normal(size=(3, 6, 4))
    e11, e22, e12 = line.in_axes(strain, angle)
    assert_allclose(e11 + e22, strain[:, 0] + strain[:, 1])
    assert_allclose(e11 * e22 - e12**2 / 4, strain[:, 0] * strain[:, 1] - strain[:, 3] ** 2 / 4)
    normal = line.normals(angle)
    tensor = np.stack([strain[:, 0], strain[:, 3] / 2, strain[:, 3] / 2, strain[:, 1]]).reshape(2, 2, 3, 4)
    tangent = np.stack([normal[:, 1], -normal[:, 0]], axis=1)
    assert_allclose(e22, np.einsum("ni,ijnk,nj->nk", normal, tensor, normal))
    assert_allclose(e12, 2 * np.einsum("ni,ijnk,nj->nk", tangent, tensor, normal))
    assert (tangent[:, 0] > 0).all()  # rising with x


# --- energy ---


@pytest.mark.parametrize("shape", [(5,), (5, 2)])
def test_finite_sed_is_hookes_and_incompressible_sed_omits_the_volume_change(shape: tuple[int, ...]) -> None:
    material = Elastic(1000.0, 0.48)
    e11, e22, e12 = np.random.default_rng(2).normal(size=(3, *shape))
    full = np.stack([e11, e22, 0 * e11, e12, 0 * e11, 0 * e11], axis=-1)
    strain = np.stack([e11, e22, e12])
    assert_allclose(sed_of(strain, material, "finite"), measures_from_strain(full, material)["sed"])
    shear = 1000 / 2.96
    source = shear * (e11**2 + e22**2 + e12**2 / 2)  # Raju 1998, Eq. 6.1
    assert_allclose(sed_of(strain, material, "incompressible"), source)
    assert squared_parts(strain, material, "incompressible").shape == (3, *shape)
    assert squared_parts(strain, material, "finite").shape == (4, *shape)


# --- the section, sampled ---


def test_the_section_samples_lie_where_raju_has_them(section: SampledSection) -> None:
    places = section.sampling.place_mm
    assert (places[0], places[24], places[-1], len(places)) == (pytest.approx(-4.08), 0.0, pytest.approx(4.08), 49)
    receptors = section.finger.model.receptors.position_mm
    foot = np.stack(section.line.surface.section(section.line.angles(places), PLANE), axis=1)
    assert_allclose(np.linalg.norm(foot - receptors[:, :2], axis=1), 0.76)  # Raju 1998, ch. 5
    assert section.material == Elastic(1000.0, 0.48)  # dermis: a tenth of the epidermis


@pytest.mark.parametrize("x_mm", [0.0, 0.23, -1.9])
def test_a_point_load_on_the_section_equals_the_line_load_of_the_influence(
    section: SampledSection, x_mm: float
) -> None:
    load = section.finger.point_load(x_mm, 3.0)
    angle = section.line.angles(section.sampling.place_mm)
    per_force = section.under_loads(section.line.places(x_mm))[:, :, 0, 0] * PSEUDO_E_EPIDERMIS
    assert_allclose(
        section.line.in_axes(load.receptor_strain, angle),
        per_force * load.force_n / section.finger.e_epidermis_mpa,
        rtol=1e-6,
        atol=1e-9,
    )
    with raises(ModelRangeError, "z_of_section", z_mm=6.5):
        section.finger.point_load(x_mm, 3.0, z_mm=6.5)


# --- h, g, f ---


def test_a_load_stretches_the_tissue_along_the_skin_and_compresses_it_across(responses: ImpulseResponses) -> None:
    h, g, f = responses.strain
    assert (np.argmax(h), np.argmin(g)) == (24, 24)
    assert h[24] > 0 > g[24]
    assert f[:23].min() == f.min() < 0 < f.max() == f[26:].max()
    # stored when written, of the default mesh; 1 % is its error at a receptor (docs/validation/performance.md)
    assert_allclose([h[24], g[24], f.max()], [6.79e-5, -7.50e-5, 9.57e-5], rtol=0.01)


def test_the_impulse_responses_h_and_minus_g_agree_in_incompressible_tissue(responses: ImpulseResponses) -> None:
    """Plane strain: e11 + e22 is the change of volume, which vanishes with 1 − 2ν."""
    found = responses.opposite
    assert found == (
        pytest.approx(0.139, abs=0.002),
        pytest.approx(0.105, abs=0.002),
        pytest.approx(-0.9992, abs=2e-4),
    )
    stiff = FingertipConfig(mesh=COARSE.mesh, tissue=Tissue(poisson=0.4999))
    nearly = impulse_responses(sampled_section(stiff, Sampling())).opposite
    # 1 − 2ν is 200 times smaller; B-bar holds the volume of each element, the fit through 27 of them blurs it
    assert nearly.relative_l2 < 0.005
    assert nearly.correlation < -0.9999


def test_the_tail_of_an_impulse_response_is_its_larger_end_over_the_peak() -> None:
    strain = np.array([[1.0, 4.0, -2.0], [0.5, -1.0, 0.1], [3.0, 2.0, -6.0]])
    assert_allclose(ImpulseResponses(strain, Sampling(half_length=1), Elastic(1.0, 0.3)).tails, [0.5, 0.5, 1.0])


@pytest.mark.parametrize("axes", ["skin", "cartesian"])
def test_of_a_symmetric_finger_h_and_g_are_even_and_f_is_odd(axes: str) -> None:
    sampling = Sampling(half_length=16, axes="skin" if axes == "skin" else "cartesian")
    h, g, f = impulse_responses(sampled_section(UPRIGHT, sampling)).strain
    for even in (h, g):
        assert_allclose(even, even[::-1], atol=1e-3 * np.abs(even).max())  # the mesh's nail is not quite even
    assert_allclose(f, -f[::-1], atol=1e-3 * np.abs(f).max())


def test_the_error_of_shift_invariance_is_zero_in_the_middle_and_grows_outwards(section: SampledSection) -> None:
    found = shift_errors(section, "finite", 12)
    assert_allclose(found.place_mm, 0.17 * np.arange(-12, 13))
    assert_allclose([*found.strain[:, 12], found.sed[12]], 0.0, atol=1e-12)
    for k in (0, -1):  # 2.04 mm away; stored when written
        assert_allclose(found.strain[:, k], [[0.048, 0.045, 0.109], [0.061, 0.057, 0.124]][k], atol=0.002)
        assert found.sed[k] == pytest.approx([0.073, 0.076][k], abs=0.002)


def test_shift_invariance_errs_far_more_along_x_than_along_the_skin(section: SampledSection) -> None:
    """SCIENCE: f shifted in Cartesian axes misses by 26 to 70 % of its peak on this finger."""
    along, across = (
        shift_errors(sampled_section(FingertipConfig(), Sampling(axes=axes)), "finite", 12)
        for axes in ("skin", "cartesian")
    )
    assert (across.strain[:, [0, -1]] > 8 * along.strain[:, [0, -1]]).all()
