"""Answers that may depend on how they were reached: what is flagged, why, and what other paths make of them."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from sim.contact.profiles import Bar, IndentorProfile, Wedge
from sim.models.fingertip import Fingertip
from sim.models.many_indentations import indent_many
from sim.models.pressing import OTHER_STEPS_MM, PlacedIndentor, Pressing
from sim.models.result import IndentationOutcome, IndentationRequest, IndentationResult, Indentations

DEPENDS: tuple[Bar, float, float] = (Bar(1.5), 1.215, 0.237)
DOES_NOT: tuple[Wedge, float, float] = (Wedge(60.0), -0.7, 0.2)
CERTAIN: tuple[Bar, float, float] = (Bar(3.0), 0.0, 0.3)


def _pressed(finger: Fingertip, pose: tuple[IndentorProfile, float, float], **options: Any) -> IndentationResult:
    profile, x, doi = pose
    return finger.indent(profile, x, doi_mm=doi, **options)


@pytest.fixture(scope="module")
def depends(finger: Fingertip) -> IndentationResult:
    return _pressed(finger, DEPENDS, other_paths=True)


# --- what is flagged ---


def test_a_path_dependent_force_is_flagged_with_the_forces_of_other_paths(
    finger: Fingertip, depends: IndentationResult
) -> None:
    alone = _pressed(finger, DEPENDS)
    assert alone.may_depend_on_path
    assert alone.path_spread is None
    assert (alone.other_forces_n, alone.force_n) == ((), depends.force_n)
    assert depends.path_spread == pytest.approx(0.008828, rel=1e-3)  # studies.accuracy.branches: 0.883 %
    assert len(depends.other_forces_n) == len(OTHER_STEPS_MM) == 2
    assert min(depends.other_forces_n) > depends.force_n


def test_a_force_without_a_snap_has_no_path_spread_and_is_not_solved_again(
    finger: Fingertip, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Pressing, "by_other_paths", lambda *_: pytest.fail("solved again"))
    certain = _pressed(finger, CERTAIN, other_paths=True)
    assert (certain.may_depend_on_path, certain.path_spread, certain.other_forces_n) == (False, 0.0, ())


def test_a_flagged_force_may_have_no_path_spread(coarse_finger: Fingertip) -> None:
    result = _pressed(coarse_finger, DOES_NOT, other_paths=True)
    assert result.may_depend_on_path
    assert result.path_spread is not None
    assert 0 <= result.path_spread < 1e-8
    assert result.other_forces_n == pytest.approx((result.force_n,) * 2, rel=1e-8)


def test_force_control_compares_with_other_paths_to_the_same_depth(
    finger: Fingertip, depends: IndentationResult
) -> None:
    # The search ends at another equilibrium's depth by no more than its tolerance, and so do the other paths.
    forced = finger.indent(DEPENDS[0], DEPENDS[1], force_gwt=depends.force_gwt, other_paths=True)
    assert forced.doi_mm == pytest.approx(DEPENDS[2], abs=1e-7)
    assert forced.other_forces_n == pytest.approx(depends.other_forces_n, rel=1e-5)


# --- why: edges ---


def test_contact_at_a_sharp_edge_is_flagged_as_path_dependent(
    finger: Fingertip, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert _pressed(finger, (Bar(1.5, 0.0), 0.0, 0.3)).may_depend_on_path
    assert not _pressed(finger, (Bar(1.5, 0.05), 0.0, 0.3)).may_depend_on_path
    monkeypatch.setattr(PlacedIndentor, "bears_on_edge", lambda *_: pytest.fail("looked for"))
    assert not finger.indent("cylinder:9", 0.0, doi_mm=0.1).may_depend_on_path  # no sharp shape
    assert _pressed(finger, DEPENDS).may_depend_on_path  # snapped already


# --- what is said of it ---


@pytest.mark.parametrize(
    ("snapped", "others", "spread"),
    [
        (False, (), 0.0),
        (True, (0.9, 0.95), 0.1),
    ],
)
def test_the_path_spread_is_the_largest_relative_difference_of_forces(
    depends: IndentationResult, snapped: bool, others: tuple[float, ...], spread: float
) -> None:
    forces = tuple(depends.force_n * other for other in others)
    result = replace(depends, state=replace(depends.state, snapped=snapped), other_forces_n=forces)
    assert result.path_spread == pytest.approx(spread, abs=1e-15)
    told = result.as_json()["path"]
    assert (told["may_depend"], told["spread"]) == (snapped, result.path_spread)
    assert told["others_over_force"] == pytest.approx(others)
    assert (" path" in repr(result)) is snapped


def test_the_table_of_many_presses_has_path_flag_and_spread(
    depends: IndentationResult, coarse_finger: Fingertip
) -> None:
    certain = _pressed(coarse_finger, CERTAIN)
    rows = (depends, replace(depends, other_forces_n=()), certain, None)
    asked = IndentationRequest("bar:1.5", 0.0, None, 0.2, None)
    table = Indentations((asked,) * 4, tuple(IndentationOutcome(row, "") for row in rows)).table()
    assert table["may_depend_on_path"].tolist() == [True, True, False, False]
    assert table["path_spread"].tolist() == pytest.approx([depends.path_spread, np.nan, 0.0, np.nan], nan_ok=True)


@pytest.mark.parametrize("other_paths", [False, True])
def test_many_presses_solve_other_paths_only_on_request(coarse_finger: Fingertip, other_paths: bool) -> None:
    profile, x, doi = DOES_NOT
    found = indent_many(coarse_finger, profile, x, doi_mm=[doi, 0.05], other_paths=other_paths)
    assert found.table()["may_depend_on_path"].tolist() == [True, False]
    assert [len(result.other_forces_n) for result in found if result] == [2 * other_paths, 0]
