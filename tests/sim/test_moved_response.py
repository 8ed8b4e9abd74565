"""One response moved over the finger: exact where it was measured, right on a skin that is the same everywhere."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sim.coding.point_loaded_finger import LoadedFinger, PointLoad, Site
from sim.coding.point_spread import MovedResponse, PointSpread, in_frames, receptor_sheet, spreads
from sim.config import FingertipConfig
from sim.contact.patch import X, Z
from tests.sim.coarse_mesh import coarse_mesh

CONFIG = FingertipConfig(mesh=coarse_mesh(0.4, 0.4, round_patch_mm=2.0))
PLANE = CONFIG.receptor_plane_mm


@pytest.fixture(scope="module")
def loaded() -> LoadedFinger:
    return LoadedFinger(CONFIG)


@pytest.fixture(scope="module")
def response(loaded: LoadedFinger) -> MovedResponse:
    return MovedResponse.of(loaded, receptor_sheet(loaded, 0.4))


def about(loaded: LoadedFinger, response: MovedResponse, x_mm: float, z_mm: float) -> PointSpread:
    return spreads(loaded, response.sheet, [Site(0, x_mm, z_mm, on_pulp=True)], 2.0, 1.5)[0]


def test_where_it_was_measured_it_is_exact(loaded: LoadedFinger, response: MovedResponse) -> None:
    there = about(loaded, response, 0.0, PLANE)
    assert response.missed(there, 2.0) < 1e-9
    assert response.missed(there, 2.0 * np.sqrt(1.1)) == pytest.approx(0.1)  # SED goes with the force's square


def test_moved_along_a_straight_finger_it_is_right_and_around_a_bend_it_is_not(
    loaded: LoadedFinger, response: MovedResponse
) -> None:
    """A whole element along the finger, or a place on the tip's slope."""
    near = response.missed(about(loaded, response, 0.0, PLANE + 0.4), 2.0)
    tip = response.missed(about(loaded, response, 0.0, 10.8), 2.0)
    assert near < 0.15, near  # measured 0.12
    assert tip > 1.5 * near, tip


def test_it_is_moved_the_right_way(loaded: LoadedFinger, response: MovedResponse) -> None:
    """Its shear is odd: mirrored, or moved to the other side, it would have the other sign."""
    load = PointLoad(0.4, PLANE + 0.4)
    near = about(loaded, response, load.x_mm, load.z_mm)
    true = in_frames(
        loaded.recovery(response.sheet.at_mm).strain(loaded.moved([load]))[0], loaded.frames(response.sheet.skin_mm)
    )
    skin = response.sheet.skin_mm
    kept = np.abs(skin - near.load_mm)[:, [X, Z]].max(axis=1) < 1.5
    found = response.convolved(near.load_mm[None], np.ones(1), skin[kept])
    for k in range(5):  # e13 is next to nothing
        assert np.corrcoef(found[:, k], true[kept, k])[0, 1] > 0.9
    two = response.convolved(np.stack([near.load_mm] * 2), np.array([1.0, 2.0]), skin[kept])
    assert_allclose(two, 3 * found)
