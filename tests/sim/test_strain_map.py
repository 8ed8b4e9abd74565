"""Strain in the whole receptor plane against the condensed model's own answers."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from sim.config import FingertipConfig
from sim.models.catalogue import load
from sim.models.fingertip import Fingertip
from sim.models.full_mesh import StrainMap, displacements, mesh_of, strain_maps
from sim.models.result import IndentationResult
from tests.sim.coarse_mesh import coarse_mesh


@dataclass(frozen=True)
class Solved:
    """Indentations of a finger, the displacements under their forces, which belong to one mesh, and their maps."""

    finger: Fingertip
    results: list[IndentationResult]
    moved: NDArray[np.float64]
    maps: list[StrainMap]


@pytest.fixture(scope="module")
def fine() -> Fingertip:
    """The default's elements across the finger and in depth, where a map is compared; longer ones along it."""
    below = {"dermis_spacing_mm": 0.2, "epidermis_elements": 2, "dermis_fine_depth_mm": 1.2}
    mesh = coarse_mesh(0.17, 0.9, patch_x_mm=2.2, patch_z_mm=2.7, **below)
    return load("finger", FingertipConfig(mesh=mesh), cached=False)


@pytest.fixture(scope="module")
def solved(fine: Fingertip, coarse_finger: Fingertip) -> dict[str, Solved]:
    """Across and along a coarse finger at once; along a fine one: three meshes, each factorised once."""
    across = [coarse_finger.indent("line", doi_mm=doi) for doi in (0.3, 0.6)]
    along = [coarse_finger.indent("bar:3.0", doi_mm=doi) for doi in (0.3, 0.6)]
    alone = fine.indent("cylinder:9", doi_mm=0.4)
    moved: list[NDArray[np.float64]] = []

    def noted(*arguments: Any) -> NDArray[np.float64]:
        moved.append(displacements(*arguments))
        return moved[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sim.models.full_mesh.displacements", noted)
        maps = strain_maps(fine.config, [alone])
        mixed = strain_maps(coarse_finger.config, [across[0], along[0], across[1], along[1], across[0]])
    of_alone, *both = moved
    of_bars, of_lines = sorted(both, key=len)
    return {
        "line": Solved(coarse_finger, [*across, across[0]], of_lines, [mixed[0], mixed[2], mixed[4]]),
        "bar:3.0": Solved(coarse_finger, along, of_bars, [mixed[1], mixed[3]]),
        "cylinder:9": Solved(fine, [alone], of_alone, maps),
    }


@pytest.mark.parametrize("shape", ["bar:3.0", "line", "cylinder:9"])
def test_the_strain_map_has_the_skin_displacements_of_the_contact(solved: dict[str, Solved], shape: str) -> None:
    results = solved[shape].results
    mesh = mesh_of(solved[shape].finger.config, results[0])
    skin = np.arange(len(mesh.nodes)).reshape(mesh.grid)[:, :, 0].ravel()
    for result, u, found in zip(results, solved[shape].moved, solved[shape].maps, strict=True):
        there = u[skin[result.model.patch_in_skin]][:, result.model.patch.axes].T
        # the same equations, solved whole and condensed: they agreed to 1e-10 in test_uncondensed.py
        np.testing.assert_allclose(there, result.state.displacement, rtol=0, atol=1e-9)
        plane = int(np.argmin(np.abs(mesh.z_mm - solved[shape].finger.config.receptor_plane_mm)))
        section = u.reshape(*mesh.grid, 3)[plane]
        np.testing.assert_allclose((found.moved_mm - found.corner_mm)[:-1], section[..., :2], rtol=0, atol=1e-12)


def test_the_strain_map_agrees_with_the_receptors(solved: dict[str, Solved]) -> None:
    """Receptors are a quadratic through 27 centroids; the map has one value an element of the plane."""
    (result,), (found,) = solved["cylinder:9"].results, solved["cylinder:9"].maps
    outer = 0.5 * (found.corner_mm[1:] + found.corner_mm[:-1])
    centre = 0.5 * (outer[:, 1:] + outer[:, :-1])
    receptors = result.model.receptors.position_mm[:, None, None, :2]
    nearest = ((centre - receptors) ** 2).sum(axis=-1).reshape(len(receptors), -1).argmin(axis=1)
    for name in ("ep1", "e22", "sed"):
        read, near = result.receptor_measures[name], found.measures[name].ravel()[nearest]
        # the element's centroid lies up to 0.13 mm from the receptor, where measures fall by e in about 1 mm
        np.testing.assert_allclose(near, read, rtol=0, atol=0.13 * np.abs(read).max())


def test_the_strain_map_shows_the_skin_where_the_contact_has_it(
    coarse_finger: Fingertip, solved: dict[str, Solved]
) -> None:
    result, found, other = solved["bar:3.0"].results[1], solved["bar:3.0"].maps[1], solved["line"].maps[0]
    assert other.moved_mm[:, 0, 1].max() < other.corner_mm[:, 0, 1].max()
    x, y = result.skin_profile
    skin = found.moved_mm[:, 0]
    pulp = skin[(skin[:, 1] > 1) & (skin[:, 0] >= x.min()) & (skin[:, 0] <= x.max())]
    assert len(pulp) >= len(x) - 2  # of the ends round-off may leave one out
    np.testing.assert_allclose(np.interp(np.sort(pulp[:, 0]), x, y), pulp[np.argsort(pulp[:, 0]), 1], atol=1e-6)
    assert found.measures["sed"].min() >= 0
    height_mm = float(coarse_finger.surface.height(0.0, coarse_finger.config.receptor_plane_mm))
    on_the_skin = np.array([[0.0, height_mm - 5e-3]])  # the edges of elements of 0.3 mm lie 2 µm below the round skin
    # a point of the skin's middle under a flat bar goes down by the depth
    np.testing.assert_allclose(found.carried(on_the_skin)[0, 1] - on_the_skin[0, 1], -0.6, atol=0.02)
