"""SED under point loads all over the pulp: where they are, what is fitted, and how round it is."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sim.coding.point_loaded_finger import (
    LoadedFinger,
    PointLoad,
    Site,
    energy_density,
    published_sites,
    published_table,
)
from sim.coding.point_spread import (
    Judged,
    MovedResponse,
    PointSpread,
    Sheet,
    in_frames,
    judged,
    mean_over,
    receptor_sheet,
    spreads,
)
from sim.coding.power_law import PowerLaw, fitted
from sim.config import FingertipConfig
from sim.contact.patch import X, Z
from sim.errors import ModelRangeError
from sim.measures.receptors import depths_of
from sim.models.condensed import point_force
from tests.error_codes import raises
from tests.sim.coarse_mesh import coarse_mesh

MIDDLE = Site(10, 0.098, 6.893, on_pulp=True)


@pytest.fixture(scope="module")
def loaded(coarse_config: FingertipConfig) -> LoadedFinger:
    return LoadedFinger(coarse_config)


# --- what the source has ---


def test_the_point_load_sites_are_those_of_the_source() -> None:
    sites = published_sites()
    assert [site.number for site in sites] == list(range(1, 25))
    assert [site.on_pulp for site in sites] == [True] * 18 + [False] * 6
    assert sites[9] == MIDDLE


def test_the_published_table_has_the_means_and_spreads_of_the_text() -> None:
    """Raju 1998: A spread 10.2 % and m 3.886 ± 4.9 % over the pulp, 17.7 % and 6.2 % over all."""
    table = published_table()
    assert (table[9].number, table[9].a, table[9].m, table[9].r2) == (10, 12.805, 3.959, 0.961)
    pulp, everything = mean_over(table[:18]), mean_over(table)
    assert (pulp.m, pulp.a) == (pytest.approx(3.886, abs=5e-4), pytest.approx(12.0446, abs=1e-4))
    assert [round(100 * v, 1) for v in (pulp.a_spread, pulp.m_spread)] == [10.2, 4.9]
    assert [round(100 * v, 1) for v in (everything.a_spread, everything.m_spread)] == [17.7, 6.2]


# --- fits ---


@pytest.mark.parametrize("kind", ["linear", "logarithmic"])
def test_fitting_recovers_a_power_law(kind: str) -> None:
    r = np.linspace(0.76, 2.0, 30)
    law = fitted(r, 12.8 / r**3.96, kind)  # type: ignore[arg-type]
    assert law == (pytest.approx(12.8), pytest.approx(3.96), pytest.approx(1.0), pytest.approx(1.0))
    assert_allclose(law.at(r), 12.8 / r**3.96)


# --- the finger ---


def test_receptors_lie_perpendicularly_below_equally_spaced_skin(loaded: LoadedFinger) -> None:
    sheet = receptor_sheet(loaded, 0.5, 0.6)
    assert_allclose(depths_of(loaded.surface, sheet.at_mm), 0.6, atol=1e-6)
    x, y, z = sheet.skin_mm.T
    assert_allclose(y, loaded.surface.height(x, z), atol=1e-9)
    plane = loaded.config.receptor_plane_mm
    for steps in (x / 0.5, (z - plane) / 0.5):
        assert_allclose(steps, np.round(steps), atol=1e-9)
    assert {(round(a, 6), round(b, 6)) for a, b in zip(x, z, strict=True)} >= {
        (0.0, plane),
        (-3.5, plane),
        (3.5, plane),
    }
    low, high = loaded.recovered_z_mm
    assert low < sheet.at_mm[:, 2].min() < 2.5
    assert 11.0 < sheet.at_mm[:, 2].max() < high


def test_point_loads_beside_the_pulp_are_refused(loaded: LoadedFinger) -> None:
    found = loaded.skin(np.array([0.0, 4.6, -4.6, 4.37, 0.0, 0.0]), np.array([6.9, 6.9, 6.9, 6.9, -0.1, 12.8]))
    assert np.isfinite(found[0]).all()
    assert np.isnan(found[1:]).all()
    with raises(ModelRangeError, "load_beside_pulp", x_mm=5.0, z_mm=6.9):
        loaded.foot_mm(PointLoad(5.0, 6.9))


def test_point_loads_satisfy_reciprocity(loaded: LoadedFinger) -> None:
    a, b = PointLoad(0.6, 6.8), PointLoad(-1.0, 8.0, "vertical")
    moved = loaded.moved([a, b])
    work = np.einsum("knc,jnc->kj", moved, np.stack([loaded._under(one) for one in (a, b)]))
    assert work[0, 1] == pytest.approx(work[1, 0], rel=1e-9)
    assert (np.diag(work) > 0).all()


def test_sed_around_a_point_load_scales_with_the_squared_force(loaded: LoadedFinger) -> None:
    sheet = receptor_sheet(loaded, 0.5)
    one, strong = (spreads(loaded, sheet, [MIDDLE], force, 1.2)[0] for force in (1.0, 3.0))
    assert_allclose(strong.sed, 9 * one.sed)
    recovery = loaded.interior.recovery(one.sheet.at_mm)
    moved = loaded.moved([PointLoad(MIDDLE.x_mm, MIDDLE.z_mm)])
    per_n = energy_density(recovery.strain(moved)[0], recovery.young_ratio, 0.48)
    assert_allclose(one.sed, per_n * (9.80665e-3 / 0.186266) ** 2)


def test_receptors_around_a_load_fill_a_square_of_skin(loaded: LoadedFinger) -> None:
    sheet = receptor_sheet(loaded, 0.5)
    (found,) = spreads(loaded, sheet, [MIDDLE], half_width_mm=1.2)
    x, _, z = (found.sheet.skin_mm - found.load_mm).T
    assert len(found.sed) == 5 * 5 == len(found.sheet.at_mm)
    assert (np.abs(x).max(), np.abs(z).max()) == (pytest.approx(1.098), pytest.approx(1.0))
    assert_allclose(found.distance_mm, np.linalg.norm(found.sheet.at_mm - found.load_mm, axis=1))
    with raises(ModelRangeError, "too_few_receptors", site=10, receptors=6, fewest=12):
        spreads(loaded, sheet, [MIDDLE], half_width_mm=0.5)
    assert len(spreads(loaded, sheet, [MIDDLE], half_width_mm=0.95)[0].sed) == 12


# --- how round it is ---


def _flat(sed_over_law: object) -> PointSpread:
    """A flat sheet 0.5 mm below a load at the origin, r^-4 times a function of the azimuth."""
    x, z = (v.ravel() for v in np.meshgrid(0.1 * np.arange(-15, 16), 0.1 * np.arange(-15, 16)))
    skin = np.stack([x, 0 * x, z], axis=1)
    at = skin - [0.0, 0.5, 0.0]
    r = np.linalg.norm(at, axis=1)
    return PointSpread(MIDDLE, np.zeros(3), Sheet(skin, at), sed_over_law(np.arctan2(z, x)) / r**4, 0.1 + 0 * r)  # type: ignore[operator]


def test_a_round_spread_has_no_asymmetry() -> None:
    spread = _flat(lambda azimuth: 2.0 + 0 * azimuth)
    found = judged(spread)
    assert found.linear.m == pytest.approx(4.0) == found.logarithmic.m
    assert_allclose(spread.by_azimuth(found.linear), 1.0)
    assert found.asymmetry == pytest.approx(0.0, abs=1e-9)


def test_sectors_of_a_spread_are_counted_from_x_towards_z() -> None:
    law = PowerLaw(1.0, 4.0, 1.0, 1.0)
    ahead = _flat(lambda azimuth: np.where(np.abs(azimuth) < np.radians(22), 3.0, 1.0)).by_azimuth(law)
    assert (ahead[0] > 2.8, ahead[1], ahead[7], ahead[4]) == (True, 1.0, 1.0, 1.0)
    along = _flat(lambda azimuth: np.where(np.abs(azimuth - np.pi / 2) < np.radians(22), 3.0, 1.0))
    assert along.by_azimuth(law).argmax() == 2
    assert Judged(along, law, law).asymmetry == pytest.approx(along.by_azimuth(law)[2] - 1.0)


# --- meshes, loads and what is kept of them ---


def test_a_force_between_nodes_is_shared_by_bilinear_weights() -> None:
    z, phi = np.array([0.0, 1.0, 3.0]), np.array([0.0, 2.0])
    assert_allclose(point_force(z, phi, (2.5, 0.5)), [[0, 0], [0.1875, 0.0625], [0.5625, 0.1875]])
    assert_allclose(point_force(z, phi, (1.0, 2.0)), [[0, 0], [0, 1], [0, 0]])
    assert_allclose(point_force(z, phi, (0.0, 0.0))[0], [1, 0])
    assert_allclose(point_force(z[:1], phi, (7.0, 0.5)), [[0.75, 0.25]])  # a section has one place along z


# --- one response moved over the finger ---

CONFIG = FingertipConfig(mesh=coarse_mesh(0.4, 0.4, round_patch_mm=2.0))
PLANE_MM = CONFIG.receptor_plane_mm


@pytest.fixture(scope="module")
def coarse_loaded() -> LoadedFinger:
    return LoadedFinger(CONFIG)


@pytest.fixture(scope="module")
def response(coarse_loaded: LoadedFinger) -> MovedResponse:
    return MovedResponse.of(coarse_loaded, receptor_sheet(coarse_loaded, 0.4))


def about(coarse_loaded: LoadedFinger, response: MovedResponse, x_mm: float, z_mm: float) -> PointSpread:
    return spreads(coarse_loaded, response.sheet, [Site(0, x_mm, z_mm, on_pulp=True)], 2.0, 1.5)[0]


def test_a_shifted_response_is_exact_at_its_own_place(coarse_loaded: LoadedFinger, response: MovedResponse) -> None:
    there = about(coarse_loaded, response, 0.0, PLANE_MM)
    assert response.missed(there, 2.0) < 1e-9
    assert response.missed(there, 2.0 * np.sqrt(1.1)) == pytest.approx(0.1)  # SED goes with the force's square


def test_a_shifted_response_is_accurate_along_the_finger_and_not_at_the_bent_tip(
    coarse_loaded: LoadedFinger, response: MovedResponse
) -> None:
    """A whole element along the finger, or a place on the tip's slope."""
    near = response.missed(about(coarse_loaded, response, 0.0, PLANE_MM + 0.4), 2.0)
    tip = response.missed(about(coarse_loaded, response, 0.0, 10.8), 2.0)
    assert near < 0.15, near  # measured 0.12
    assert tip > 1.5 * near, tip


def test_a_shifted_response_keeps_its_orientation(coarse_loaded: LoadedFinger, response: MovedResponse) -> None:
    """Its shear is odd: mirrored, or moved to the other side, it would have the other sign."""
    load = PointLoad(0.4, PLANE_MM + 0.4)
    near = about(coarse_loaded, response, load.x_mm, load.z_mm)
    true = in_frames(
        coarse_loaded.recovery(response.sheet.at_mm).strain(coarse_loaded.moved([load]))[0],
        coarse_loaded.frames(response.sheet.skin_mm),
    )
    skin = response.sheet.skin_mm
    kept = np.abs(skin - near.load_mm)[:, [X, Z]].max(axis=1) < 1.5
    found = response.convolved(near.load_mm[None], np.ones(1), skin[kept])
    for k in range(5):  # e13 is next to nothing
        assert np.corrcoef(found[:, k], true[kept, k])[0, 1] > 0.9
    two = response.convolved(np.stack([near.load_mm] * 2), np.array([1.0, 2.0]), skin[kept])
    assert_allclose(two, 3 * found)
