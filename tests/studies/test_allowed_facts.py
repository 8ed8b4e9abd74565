"""Which fingers the source allows: parameters, facts and their halves, fixed before any finger was pressed."""

import math

import numpy as np
import pytest

from sim.finger.surface import FingertipSurface
from studies.source.allowed import ranges
from studies.source.allowed.facts import CHECK, CHOOSE, FACTS, FIGURES_IN_PAIRS, GIVEN, SCENES, halves
from studies.source.allowed.ranges import DEFAULT, NAMES, RANGES, finger_of, place_of, values_at
from studies.source.printed.catalogue import ENTRIES

BY_EYE = {"Table 5.2", "ch. 5, survivors", "ch. 5, widths"}
BY_A_RECORDING = {"5-12, 5-13"}
"""Compared with one afferent, which says nothing about the source's finger."""


# --- halves ---


def test_figures_are_split_by_a_coin_that_can_be_thrown_again() -> None:
    assert CHOOSE == (
        "ch. 3, geometry", "ch. 4, bar 1.5", "4-8", "4-4", "ch. 4, SED under step 1", "5-3", "5-10, 5-11",
    )  # fmt: skip
    assert CHECK == (
        "4-9, Eq. 4.1, 4.2", "4-1", "4-3", "4-5", "4-7", "ch. 5, two forces", "5-5, 5-6, 5-7",
    )  # fmt: skip
    assert halves(1998) == (CHOOSE, CHECK)
    assert any(halves(seed)[0] != CHOOSE for seed in range(5))


def test_a_figure_is_in_one_half_and_each_pair_in_both() -> None:
    assert not set(CHOOSE) & set(CHECK)
    assert all(len({*pair} & {*CHOOSE}) == len({*pair} & {*CHECK}) == 1 for pair in FIGURES_IN_PAIRS)
    assert (set(GIVEN[0]) <= set(CHOOSE), set(GIVEN[1]) <= set(CHECK)) == (True, True)


def test_every_figure_with_claims_takes_part_but_those_judged_by_eye() -> None:
    """Chapter 6 encodes and decodes what chapters 3 to 5 found: no fact of the finger's."""
    claimed = {entry.number for entry in ENTRIES if entry.claims and not entry.elsewhere}
    assert {*CHOOSE, *CHECK} == claimed - BY_EYE - BY_A_RECORDING
    assert {fact.figure for fact in FACTS} == {*CHOOSE, *CHECK}


# --- facts ---


def test_a_fact_has_a_key_of_its_own_a_target_and_an_error() -> None:
    assert len({fact.key for fact in FACTS}) == len(FACTS) == 68
    for fact in FACTS:
        assert fact.low <= fact.high
        assert math.isfinite(fact.low) or math.isfinite(fact.high), fact
        assert fact.reading > 0, fact
        assert fact.model >= 0, fact


def test_nothing_is_pressed_twice() -> None:
    assert len(set(SCENES)) == len(SCENES)


# --- parameters ---


@pytest.mark.parametrize("one", RANGES, ids=lambda one: one.name)
def test_a_range_holds_the_default_and_goes_there_and_back(one: ranges.Range) -> None:
    assert one.low < one.default < one.high
    assert one.why
    assert (one.at(0.0), one.at(1.0)) == (pytest.approx(one.low), pytest.approx(one.high))
    assert one.unit(one.at(0.3)) == pytest.approx(0.3)
    middle = math.sqrt(one.low * one.high) if one.log else (one.low + one.high) / 2
    assert one.at(0.5) == pytest.approx(middle)


def test_a_place_is_its_values() -> None:
    place = np.linspace(0.05, 0.95, len(NAMES))
    np.testing.assert_allclose(place_of(values_at(place)), place, rtol=1e-12)


def test_defaults_are_those_of_the_default_finger() -> None:
    made = finger_of(DEFAULT, {})
    assert made.model_dump(exclude={"contact"}) == type(made)().model_dump(exclude={"contact"})
    assert made.contact.patch_gb == 0


def test_another_bone_axis_moves_the_points_and_nothing_else_of_them() -> None:
    up = finger_of({**DEFAULT, "bone_axis_mm": 0.5}, ranges.COARSE)
    assert up.geometry.proximal_apex_mm == pytest.approx(2.1)
    assert up.mesh.spacing_mm == 0.22
    skin, own = FingertipSurface.fit(up.geometry), FingertipSurface.fit(finger_of(DEFAULT, {}).geometry)
    assert skin.apex.position_mm[1] == pytest.approx(own.apex.position_mm[1] - 0.5, abs=0.01)
    assert np.sqrt(np.mean(skin.residuals_mm() ** 2)) < 0.011
