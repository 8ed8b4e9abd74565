"""Strain maps of a run for the report."""

from collections import Counter

import numpy as np
import pytest

from rig.compare.stimuli import MAPPED, stimuli, stimulus_maps
from rig.data import Run
from rig.report.profile_figures import strain_maps
from sim.models.fingertip import Fingertip


def test_maps_at_three_positions_are_kept(bar_run: Run, finger: Fingertip, work: Counter[str]) -> None:
    pressed = stimuli(bar_run, finger)
    found = stimulus_maps(bar_run, finger, pressed)
    assert [section.x_mm for section in found] == pytest.approx([-0.2, 0.1, 0.4], abs=1e-3)  # of −0.6 … 0.8
    work.clear()
    again = stimulus_maps(bar_run, finger, pressed)
    assert not work, "neither a contact nor a factorisation"
    for one, other in zip(found, again, strict=True):
        np.testing.assert_array_equal(one.values["sed"], other.values["sed"])


def test_a_map_shows_what_the_receptors_feel(bar_run: Run, finger: Fingertip) -> None:
    (stimulus,) = stimuli(bar_run, finger)
    middle = stimulus_maps(bar_run, finger, [stimulus])[1]
    k = int(np.argmin(np.abs(stimulus.x_mm - middle.x_mm)))
    outer = 0.5 * (middle.corner_mm[1:] + middle.corner_mm[:-1])
    centre = (0.5 * (outer[:, 1:] + outer[:, :-1])).reshape(-1, 2)
    nearest = [int(((centre - at) ** 2).sum(axis=1).argmin()) for at in middle.receptor_mm]
    for name in MAPPED:
        felt = np.array([stimulus.ssrp(name, receptor)[k] for receptor in range(len(nearest))])
        # an element's own centroid lies up to 0.13 mm from the receptor, where measures fall by e in about 1 mm
        np.testing.assert_allclose(middle.values[name].ravel()[nearest], felt, rtol=0, atol=0.15 * felt.max())


def test_the_figure_has_a_panel_for_each_position_and_measure(bar_run: Run, finger: Fingertip) -> None:
    text = strain_maps(stimulus_maps(bar_run, finger, stimuli(bar_run, finger))).svg
    assert text.count('<g id="axes_') == len(MAPPED) * (3 + 1)  # and a colour bar a row
