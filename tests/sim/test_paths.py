"""Answers that may depend on how they were reached: what is flagged, why, and what other paths make of them."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from sim.contact import newton, solver
from sim.contact.first_contact import FirstTouch, first_touch
from sim.contact.indentor import BOTH, Indentor, Prismatic, Revolved
from sim.contact.newton import Onward
from sim.contact.profiles import Bar, Cylinder, Grating, IndentorProfile, SinusoidalStep, Wedge
from sim.contact.shapes import parse_shape
from sim.contact.solver import ContactState
from sim.models.fingertip import Fingertip
from sim.models.many_indentations import indent_many
from sim.models.pressing import OTHER_STEPS_MM, PlacedIndentor, Pressing
from sim.models.result import IndentationOutcome, IndentationRequest, IndentationResult, Indentations

Array = NDArray[np.float64]

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


def test_an_answer_that_depends_on_its_path_is_flagged_and_has_both(
    finger: Fingertip, depends: IndentationResult
) -> None:
    alone = _pressed(finger, DEPENDS)
    assert alone.may_depend_on_path
    assert alone.path_spread is None
    assert (alone.other_forces_n, alone.force_n) == ((), depends.force_n)
    assert depends.path_spread == pytest.approx(0.008828, rel=1e-3)  # studies.accuracy.branches: 0.883 %
    assert len(depends.other_forces_n) == len(OTHER_STEPS_MM) == 2
    assert min(depends.other_forces_n) > depends.force_n


def test_an_answer_after_which_nothing_snapped_is_certain(finger: Fingertip, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Pressing, "by_other_paths", lambda *_: pytest.fail("solved again"))
    certain = _pressed(finger, CERTAIN, other_paths=True)
    assert (certain.may_depend_on_path, certain.path_spread, certain.other_forces_n) == (False, 0.0, ())


def test_a_flag_may_turn_out_to_be_nothing(coarse_finger: Fingertip) -> None:
    result = _pressed(coarse_finger, DOES_NOT, other_paths=True)
    assert result.may_depend_on_path
    assert result.path_spread is not None
    assert 0 <= result.path_spread < 1e-8
    assert result.other_forces_n == pytest.approx((result.force_n,) * 2, rel=1e-8)


def test_a_force_is_held_against_other_paths_to_its_depth(finger: Fingertip, depends: IndentationResult) -> None:
    # The search ends at another equilibrium's depth by no more than its tolerance, and so do the other paths.
    forced = finger.indent(DEPENDS[0], DEPENDS[1], force_gwt=depends.force_gwt, other_paths=True)
    assert forced.doi_mm == pytest.approx(DEPENDS[2], abs=1e-7)
    assert forced.other_forces_n == pytest.approx(depends.other_forces_n, rel=1e-5)


def test_other_paths_are_the_same_steps_from_first_touch(finger: Fingertip, monkeypatch: pytest.MonkeyPatch) -> None:
    indentor = Indentor.along(DOES_NOT[0])
    touch = first_touch(indentor, (0.3,), finger.surface)
    pressing = Pressing(PlacedIndentor(indentor, (0.3,), touch.height_mm, touch, finger.model), True, 1e-10)
    asked: list[tuple[float, float | None]] = []
    at = Pressing._at

    def told(self: Pressing, doi: float, start: ContactState | None, target: float | None) -> ContactState:
        asked.append((doi, target))
        return at(self, doi, start, target)

    monkeypatch.setattr(Pressing, "_at", told)
    assert len(pressing.by_other_paths(0.026)) == 2
    assert [doi for doi, _ in asked] == pytest.approx([0.0125, 0.025, 0.026, 0.00625, 0.0125, 0.01875, 0.025, 0.026])
    assert [target for _, target in asked] == [None, None, 1e-10, None, None, None, None, 1e-10]


@pytest.mark.parametrize(
    ("profile", "x", "steps"),
    [
        (Wedge(60.0), 0.3, [0.05, 0.1, 0.12]),  # touches at the corner
        (
            SinusoidalStep("1"),
            0.45,
            [0.12, 0.05, 0.1, 0.12],
        ),  # reaches it in a long step, which is gone again in short ones
        (Bar(3.0), 0.0, [0.12]),  # does not
    ],
)
def test_what_touches_at_a_corner_is_pressed_in_by_short_steps_at_once(
    finger: Fingertip, monkeypatch: pytest.MonkeyPatch, profile: IndentorProfile, x: float, steps: list[float]
) -> None:
    asked: list[float] = []
    at = Pressing._at

    def told(self: Pressing, doi: float, start: ContactState | None, target: float | None) -> ContactState:
        asked.append(doi)
        return at(self, doi, start, target)

    monkeypatch.setattr(Pressing, "_at", told)
    finger.indent(Indentor.along(profile), x, doi_mm=0.12)
    assert asked == pytest.approx(steps)


# --- why: an equilibrium that is unstable ---


@pytest.mark.parametrize(
    ("eigenvalues", "unstable"),
    [((1.0, 0.5), False), ((1.0, 1e-6), False), ((1.0, -1e-6), True), ((1.0, -2.0), True), ((), False)],
)
def test_a_negative_eigenvalue_is_told(eigenvalues: tuple[float, ...], unstable: bool) -> None:
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])[: len(eigenvalues), : len(eigenvalues)]
    matrix = turn @ np.diag(eigenvalues) @ turn.T
    assert newton._solve_positive(matrix, np.ones(len(eigenvalues)), 0.05)[1] is unstable


@pytest.mark.parametrize(("soft", "unstable"), [(0.5, False), (-0.5, True)])
def test_also_beside_what_is_concave(soft: float, unstable: bool) -> None:
    matrix = np.diag([0.9, soft])
    assert newton._turned(matrix, np.ones(2), np.array([True, False]), 0.05)[1] is unstable


@pytest.mark.parametrize("unstable", [False, True])
def test_one_unstable_pass_is_enough(finger: Fingertip, monkeypatch: pytest.MonkeyPatch, unstable: bool) -> None:
    predicted, doi, calls = solver.predicted, [0.0], list[float]()
    at = Pressing._at

    def on_the_way(self: Pressing, doi_mm: float, start: ContactState | None, target: float | None) -> ContactState:
        doi[0] = doi_mm
        return at(self, doi_mm, start, target)

    def told(*arguments: Any) -> Onward | None:
        onward = predicted(*arguments)
        calls.append(doi[0])
        return onward and onward._replace(unstable=unstable and calls.count(0.1) == 1 and doi[0] == 0.1)

    monkeypatch.setattr(solver, "predicted", told)
    monkeypatch.setattr(Pressing, "_at", on_the_way)
    result = _pressed(finger, (SinusoidalStep("1"), -0.5, 0.2))
    assert calls.count(0.1) > 1
    assert result.may_depend_on_path is unstable


@pytest.mark.parametrize("before", [False, True])
@pytest.mark.parametrize("now", [False, True])
def test_what_snapped_on_the_way_stays_so(
    coarse_finger: Fingertip, monkeypatch: pytest.MonkeyPatch, before: bool, now: bool
) -> None:
    state = replace(_pressed(coarse_finger, CERTAIN).state, snapped=now)
    monkeypatch.setattr(Pressing, "_at", lambda *_: state)
    indentor = Indentor.along(CERTAIN[0])
    touch = first_touch(indentor, (0.0,), coarse_finger.surface)
    pressing = Pressing(PlacedIndentor(indentor, (0.0,), touch.height_mm, touch, coarse_finger.model), True, 1e-10)
    assert pressing._step(0.3, replace(state, snapped=before), None).snapped is (before or now)
    assert pressing._step(0.3, None, None).snapped is now


# --- why: edges ---

EDGES: list[tuple[Callable[[float], IndentorProfile], float]] = [  # of a radius, and where it ends
    (lambda r: Bar(2.0, r), 1.0),
    (lambda r: Grating(0.8, 1.6, r), 0.4),
    (lambda r: Wedge(60.0, r), 0.0),
    (lambda r: Wedge(45.0, r), 0.0),
]


def _near_an_edge(indentor: Indentor, *bearing_mm: float) -> bool:
    """Whether an edge lies near a place that bears, without a finger."""
    placed = PlacedIndentor(indentor, (0.0,), 0.0, FirstTouch(0.0, (0.0,)), None)  # type: ignore[arg-type]
    object.__setattr__(placed, "_bearing_mm", lambda _: np.array(bearing_mm)[:, None])
    return placed.bears_on_edge(None)  # type: ignore[arg-type]


@pytest.mark.parametrize(("make", "at"), EDGES)
@pytest.mark.parametrize(
    ("radius", "edge"), [(0.0, True), (0.01, True), (0.018, True), (0.022, False), (0.05, False)]
)
def test_radii_below_0_02_mm_are_edges(make: Any, at: float, radius: float, edge: bool) -> None:
    indentor = Indentor.along(make(radius))
    assert _near_an_edge(indentor, at) is edge
    assert _near_an_edge(indentor, at - 0.09) is edge
    assert _near_an_edge(indentor, at - 0.2) is False


@pytest.mark.parametrize(("radius", "edge"), [(0.0, True), (0.015, True), (0.03, False)])
def test_the_edge_on_the_other_side_is_one_too(radius: float, edge: bool) -> None:
    assert _near_an_edge(Indentor.along(Bar(2.0, radius)), -1.0) is edge


@pytest.mark.parametrize("profile", [Cylinder(9.0), SinusoidalStep("1"), SinusoidalStep("5"), Bar(2.0, 0.2)])
@pytest.mark.parametrize("at", np.linspace(-1.3, 1.3, 9))
def test_what_is_round_has_none(profile: IndentorProfile, at: float) -> None:
    assert _near_an_edge(Indentor.along(profile), at) is False


def test_a_hollow_is_none() -> None:
    groove = Indentor.along(Grating(0.8, 1.6, 0.05))
    assert _near_an_edge(groove, 0.4 + 0.05 + 0.01) is False  # the floor's corner, which takes no hold away


def test_edges_of_shapes_that_slope_both_ways_are_seen_along_each() -> None:
    turned = Prismatic("turned", Bar(2.0, 0.0), BOTH, (0.0, 1.0))
    assert _near_an_edge(turned, 0.3, 1.0)
    assert not _near_an_edge(turned, 1.0, 0.3)
    round_edge = Revolved("flat", Bar(2.0, 0.0))
    assert _near_an_edge(round_edge, 1.0, 0.0)
    assert _near_an_edge(round_edge, 0.0, -1.0)
    assert not _near_an_edge(round_edge, 0.3, 0.3)


def test_bearing_at_an_edge_is_flagged_though_nothing_snapped(
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
        (True, (1.25, 0.75), 0.4),
        (False, (0.5,), 0.5),
        (True, (1.0,), 0.0),
    ],
)
def test_spread(depends: IndentationResult, snapped: bool, others: tuple[float, ...], spread: float) -> None:
    forces = tuple(depends.force_n * other for other in others)
    result = replace(depends, state=replace(depends.state, snapped=snapped), other_forces_n=forces)
    assert result.path_spread == pytest.approx(spread, abs=1e-15)
    told = result.as_json()["path"]
    assert (told["may_depend"], told["spread"]) == (snapped, result.path_spread)
    assert told["others_over_force"] == pytest.approx(others)
    assert (" path" in repr(result)) is snapped


def test_no_force_has_no_spread(depends: IndentationResult) -> None:
    assert replace(depends, force_n=0.0, other_forces_n=(0.0,)).path_spread == 0.0


def test_what_was_not_asked_for_is_null(depends: IndentationResult) -> None:
    told = replace(depends, other_forces_n=()).as_json()["path"]
    assert told == {"may_depend": True, "spread": None, "others_over_force": []}


def test_tables_have_flag_and_spread(depends: IndentationResult, coarse_finger: Fingertip) -> None:
    certain = _pressed(coarse_finger, CERTAIN)
    rows = (depends, replace(depends, other_forces_n=()), certain, None)
    asked = IndentationRequest("bar:1.5", 0.0, None, 0.2, None)
    table = Indentations((asked,) * 4, tuple(IndentationOutcome(row, "") for row in rows)).table()
    assert table["may_depend_on_path"].tolist() == [True, True, False, False]
    assert table["path_spread"].tolist() == pytest.approx([depends.path_spread, np.nan, 0.0, np.nan], nan_ok=True)


@pytest.mark.parametrize("other_paths", [False, True])
def test_many_presses_have_them_where_asked_for(coarse_finger: Fingertip, other_paths: bool) -> None:
    profile, x, doi = DOES_NOT
    found = indent_many(coarse_finger, profile, x, doi_mm=[doi, 0.05], other_paths=other_paths)
    assert found.table()["may_depend_on_path"].tolist() == [True, False]
    assert [len(result.other_forces_n) for result in found if result] == [2 * other_paths, 0]


def test_shapes_by_name_are_pressed_likewise(finger: Fingertip, depends: IndentationResult) -> None:
    named = finger.indent(parse_shape("bar:1.5"), DEPENDS[1], doi_mm=DEPENDS[2], other_paths=True)
    assert named.other_forces_n == depends.other_forces_n
