"""Afferents drawn over the pad, what a population answers, and the staircase of a stage."""

import contextlib
import math

import numpy as np
import pytest

from sim.errors import ModelRangeError
from sim.measures.receptors import ReceptorError, tissue_below
from sim.models.catalogue import load
from sim.models.fingertip import Fingertip
from sim.nerve.models import BUILT_IN
from sim.nerve.population import (
    DENSITY_PER_CM2,
    SENSITIVITY_SPREAD,
    SPACING_SHARE,
    VELOCITY_M_S,
    AfferentPopulation,
    AfferentRequest,
    Pad,
    draw,
    parse_afferents,
    population,
)
from sim.nerve.staircase import Staircase
from sim.nerve.stimulus import Stimulus
from tests.error_codes import raises


def test_afferents_are_requested_by_a_text_of_counts_classes_and_places() -> None:
    assert parse_afferents("3xSA1, 5xRA,PC@0.5:-1,2xSA1@-1") == (
        AfferentRequest("SA1", 3),
        AfferentRequest("RA", 5),
        AfferentRequest("PC", 1, (0.5, -1.0)),
        AfferentRequest("SA1", 2, (-1.0, 0.0)),
    )


REFUSED = {
    "3xQQ": ("unknown_afferent", {"model": "QQ", "known": "SA1, RA, PC"}),
    "": ("bad_afferents", {}),
    "SA1@a": ("bad_afferents", {"item": "SA1@a"}),
    "SA1@nan": ("bad_afferents", {}),
    "SA1@1:2:3": ("bad_afferents", {}),
    "0xRA": ("number_of_afferents", {"count": 0}),
    "9999999xRA": ("number_of_afferents", {"count": 9999999}),
    "SA1@9": ("afferent_off_pad", {"model": "SA1", "x_mm": 9.0, "along_mm": 0.0}),
    "RA@0:7": ("afferent_off_pad", {"model": "RA", "along_mm": 7.0}),
    "1500xPC": ("no_room", {"model": "PC"}),
}


@pytest.mark.parametrize("text", REFUSED)
def test_an_afferent_request_that_cannot_be_placed_is_refused(
    halfspace: Fingertip, text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sim.nerve.population._MOST_TRIES", 20)
    with raises(ModelRangeError, "unknown_density", density="cat paw"):
        population(halfspace, "cat paw")
    code, fields = REFUSED[text]
    with raises(ModelRangeError, code, **fields):
        draw(halfspace, text)


def test_an_afferent_depends_on_seed_class_and_number_only(halfspace: Fingertip) -> None:
    alone, together = draw(halfspace, "2xSA1", 3), draw(halfspace, "4xRA,3xSA1", 3)
    assert list(alone) == [one for one in together if one.model == "SA1"][:2]
    assert list(alone) != list(draw(halfspace, "2xSA1", 4))
    assert [one.name for one in together] == ["RA-1", "RA-2", "RA-3", "RA-4", "SA1-1", "SA1-2", "SA1-3"]


def test_end_organs_lie_within_the_receptive_field(halfspace: Fingertip) -> None:
    """As many as the class has, even in a disc; they do not depend on where an afferent lies."""
    for name, model in BUILT_IN.items():
        drawn = draw(halfspace, f"100x{name}@0", 4)
        organs = np.array([one.organs_mm for one in drawn])
        assert organs.shape == (100, model.organs, 2)
        radius = np.hypot(*organs.reshape(-1, 2).T)
        if model.organs == 1:
            assert radius.max() == 0
            continue
        assert radius.max() <= 0.5 * model.field_mm + 1e-3
        assert np.sqrt((radius**2).mean()) == pytest.approx(model.field_mm / math.sqrt(8), rel=0.05)
        assert len({one.organs_mm for one in drawn}) == len(drawn)
        assert draw(halfspace, f"{name}@0.4:0.3", 4)[0].organs_mm == drawn[0].organs_mm


def test_end_organs_outside_the_tissue_are_drawn_again() -> None:
    finger = load("finger")
    pad = Pad.of(finger)
    edge = draw(finger, f"8xRA@{math.floor(100 * pad.half_x_mm) / 100}", 1)
    assert edge.points_mm(finger).shape == (8 * BUILT_IN["RA"].organs, 3)
    assert max(one.x_mm + x_mm for one in edge for x_mm, _ in one.organs_mm) > pad.half_x_mm


def test_tissue_places_found_together_equal_those_found_one_by_one(halfspace: Fingertip) -> None:
    """Also which have no tissue: beside the skin, below the bone's surface, at an end."""
    rng, depth = np.random.default_rng(5), 1.8
    x, along = rng.uniform(-8, 8, 12), rng.uniform(-4, 4, 12)
    z = halfspace.config.receptor_plane_mm + np.append(along[:-1], 100.0)
    together = tissue_below(halfspace.config, halfspace.surface, x, depth, z)
    found = np.full((12, 3), np.nan)
    for k in range(12):
        with contextlib.suppress(ReceptorError):
            found[k] = halfspace.points_below(x[k], depth, z[k])
    assert 2 < np.isfinite(together[:, 0]).sum() < 10
    np.testing.assert_allclose(together, found, atol=1e-9, rtol=0)


@pytest.mark.parametrize("density", ["monkey fingertip", "human fingertip"])
def test_a_population_has_the_published_density_and_spacing(halfspace: Fingertip, density: str) -> None:
    """Row 18 of the published tests: densities within 10 %, and no two afferents of a class too close."""
    found, pad = population(halfspace, density, seed=1), Pad.of(halfspace)
    for name, per_cm2 in DENSITY_PER_CM2[density].items():
        mine = np.array([(one.x_mm, one.along_mm) for one in found if one.model == name])
        assert len(mine) == pytest.approx(per_cm2 * pad.area_cm2, rel=0.1, abs=0.5)
        assert all(pad.has(*place) for place in mine)
        apart = np.hypot(*(mine[:, None] - mine[None]).T) + np.diag([math.inf] * len(mine))
        assert apart.min() >= SPACING_SHARE * 10 / math.sqrt(per_cm2) - 2e-3  # places are rounded


def test_conduction_velocities_and_sensitivities_are_as_published(halfspace: Fingertip) -> None:
    """Row 18: means within the printed ± of Knibestöl (1973), and the range of each class."""
    for name, within in {"RA": 3.4, "PC": 3.6}.items():
        mine = draw(halfspace, f"200x{name}@0", 5)
        velocity = np.array([one.velocity_m_s for one in mine])
        mean, _, lowest, highest = VELOCITY_M_S[name]
        assert velocity.mean() == pytest.approx(mean, abs=within)
        assert lowest <= velocity.min() < velocity.max() <= highest
        log = np.log([one.sensitivity for one in mine])
        assert (log.mean(), log.std()) == (
            pytest.approx(0, abs=0.1),
            pytest.approx(math.log(SENSITIVITY_SPREAD[name]), abs=0.1),
        )
        # from a monkey's fingertip to the forearm, 3 to 6 ms; a human's to the upper arm, 9 to 18 ms
        assert 0.003 <= np.median([one.delay_s() for one in mine]) <= 0.006
        assert 0.009 <= np.median([one.delay_s(0.65) for one in mine]) <= 0.018


def test_the_response_of_a_population_has_consistent_spikes_rates_and_delays(halfspace: Fingertip) -> None:
    """Rates, histogram and part of a response agree with its spikes, which come later by the delay."""
    found = draw(halfspace, "2xSA1@0,RA@0", 2)
    stimulus = Stimulus.ramp(0.4, 4.0, 0.5)
    near = found.response(halfspace, "cylinder:9", stimulus, path_m=0.2)
    far = found.response(halfspace, "cylinder:9", stimulus, path_m=0.65)
    assert [len(one) for one in near.spikes] == [len(one) for one in far.spikes]
    for one, a, b in zip(found, near.spikes, far.spikes, strict=True):
        np.testing.assert_allclose(b - a, 0.45 / one.velocity_m_s, rtol=0, atol=1e-12)
    edges, rate = near.psth(0.05)
    assert (rate * np.diff(edges)).sum(axis=1).round().tolist() == [len(one) for one in near.spikes]
    np.testing.assert_allclose(near.rate(0.1, 0.3), [((s >= 0.1) & (s < 0.3)).sum() / 0.2 for s in near.spikes])
    assert len(near.only("SA1").spikes) == 2
    assert near.only("RA").spikes[0] is near.spikes[2]
    with raises(ModelRangeError, "no_window"):
        near.rate(0.3, 0.1)
    again = found.response(halfspace, "cylinder:9", stimulus, path_m=0.2)
    assert all(np.array_equal(a, b) for a, b in zip(near.spikes, again.spikes, strict=True))
    (alone,) = AfferentPopulation([found[2]]).response(halfspace, "cylinder:9", stimulus).spikes
    assert np.array_equal(alone, near.spikes[2])


# --- the staircase ---


def test_a_staircase_stimulus_moves_with_the_stage_acceleration_and_rests() -> None:
    """0.3 mm at 1 mm/s and 50 mm/s²: 0.3 s and 0.02 s more, halfway after half of it; then a rest."""
    stairs = Staircase([0.0, 1.0, 2.0], [-0.1, 0.2, 0.2], [1.0, 1.0, 1.0], 50.0)
    assert stairs.depth_mm([-1.0, 0.0, 0.16, 0.32, 0.7, 1.5, 3.0]) == pytest.approx(
        [-0.1, -0.1, 0.05, 0.2, 0.2, 0.2, 0.2]
    )
    t = np.linspace(0.0, 0.32, 3201)
    speed = np.diff(stairs.depth_mm(t)) / np.diff(t)
    assert speed.max() == pytest.approx(1.0)
    assert (np.abs(np.diff(speed)) / 1e-4).max() == pytest.approx(50.0, rel=1e-3)
    assert stairs.deepest_mm == 0.2


def test_a_move_that_would_end_too_late_is_faster() -> None:
    stairs = Staircase([0.0, 0.2, 1.0], [0.0, 1.0, 0.0], [1.0, 1.0, 2.0], 50.0)
    assert stairs.depth_mm([0.1, 0.2, 0.2 + 0.27, 0.2 + 0.54]) == pytest.approx([0.5, 1.0, 0.5, 0.0])
