"""Strain maps of a run for the report."""

from collections import Counter

import numpy as np
import pytest

from rig.compare.stimuli import MAPPED, stimuli, stimulus_maps
from rig.data import Run
from sim.config import FingertipConfig
from sim.models.fingertip import Fingertip
from tests.rig.compare.conftest import BAR, dry_run_of
from tests.sim.coarse_mesh import coarse_mesh


@pytest.fixture(scope="module")
def coarse() -> Fingertip:
    """A finger whose whole mesh is soon solved, with elements of 0.2 mm about its receptors."""
    mesh = coarse_mesh(0.2, 0.7, dermis_spacing_mm=0.2, dermis_fine_depth_mm=1.0, patch_x_mm=2.5, patch_z_mm=2.1)
    return Fingertip.load(FingertipConfig(mesh=mesh))


@pytest.fixture(scope="module")
def run(coarse: Fingertip, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Bar 3.0 on it, at five places."""
    return dry_run_of(BAR, coarse, tmp_path_factory.mktemp("bar"))


def test_maps_at_three_positions_are_kept(run: Run, coarse: Fingertip, work: Counter[str]) -> None:
    pressed = stimuli(run, coarse)
    found = stimulus_maps(run, coarse, pressed)
    assert [section.x_mm for section in found] == pytest.approx([-0.2, 0.1, 0.4], abs=1e-3)  # of −0.6 … 0.8
    work.clear()
    again = stimulus_maps(run, coarse, pressed)
    assert not work, "neither a contact nor a factorisation"
    for one, other in zip(found, again, strict=True):
        np.testing.assert_array_equal(one.values["sed"], other.values["sed"])


def test_a_map_shows_what_the_receptors_feel(run: Run, coarse: Fingertip) -> None:
    (stimulus,) = stimuli(run, coarse)
    middle = stimulus_maps(run, coarse, [stimulus])[1]
    k = int(np.argmin(np.abs(stimulus.x_mm - middle.x_mm)))
    outer = 0.5 * (middle.corner_mm[1:] + middle.corner_mm[:-1])
    centre = (0.5 * (outer[:, 1:] + outer[:, :-1])).reshape(-1, 2)
    nearest = [int(((centre - at) ** 2).sum(axis=1).argmin()) for at in middle.receptor_mm]
    for name in MAPPED:
        felt = np.array([stimulus.ssrp(name, receptor)[k] for receptor in range(len(nearest))])
        # an element's own centroid lies up to 0.13 mm from the receptor, where measures fall by e in about 1 mm
        np.testing.assert_allclose(middle.values[name].ravel()[nearest], felt, rtol=0, atol=0.15 * felt.max())
