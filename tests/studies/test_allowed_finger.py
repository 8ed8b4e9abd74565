"""Which fingers the source allows: one finger asked for all facts, its model built once and kept nowhere."""

import math

import numpy as np
import pytest

from sim.contact.indentor import ALONG
from sim.measures.receptors import DEFAULT_DEPTH_MM, DEFAULT_X_MM, ReceptorError, ReceptorSet
from sim.models.fingertip import Fingertip
from sim.units import GWT_N
from studies.source.allowed import one_finger
from studies.source.allowed.facts import FACTS
from studies.source.allowed.one_finger import BuiltOnce, OwnAnswers, facts_of, finger
from studies.source.allowed.ranges import DEFAULT, Values
from studies.source.printed.answers import (
    HIGH_GWT,
    LOW_GWT,
    ROW_DEPTH_MM,
    ROW_X_MM,
    FingerAnswers,
    deep,
    forced,
    load,
)
from studies.source.printed.cylinders import DEEP_X_MM, apart
from tests.sim.coarse_mesh import coarse_mesh

MESH = coarse_mesh(0.4, 0.6).model_dump(exclude_defaults=True)
SLIM = {**DEFAULT, "tissue.bone_fraction": 0.22}


@pytest.fixture(scope="module")
def slim() -> Fingertip:
    return finger(SLIM, MESH)


def test_a_finger_carries_the_sources_force_in_the_sources_scene(slim: Fingertip) -> None:
    assert slim.indent("step:1", -1.63, doi_mm=0.73).force_gwt == pytest.approx(8.0)
    stored = load(slim.config)
    assert slim.e_epidermis_mpa != pytest.approx(stored.e_epidermis_mpa, rel=1e-3)
    ours, theirs = (f.indent("cylinder:3", doi_mm=0.4).state.normal_force for f in (slim, stored))
    assert ours == pytest.approx(theirs, rel=1e-9)
    assert pytest.approx(9.80665e-3) == GWT_N


def test_the_low_force_is_the_fingers_own_and_no_other(slim: Fingertip) -> None:
    own, plain = OwnAnswers(slim, 1.9), FingerAnswers(slim)
    low, high, depth = forced("cylinder:3", LOW_GWT), forced("cylinder:3", HIGH_GWT), deep("cylinder:3", LOW_GWT / 4)
    own.press_all([low, high, depth])
    assert own.press(low).force_gwt == pytest.approx(1.9)
    assert own.press(high).force_gwt == pytest.approx(HIGH_GWT)
    assert own.press(depth).doi_mm == depth.value
    assert plain.press(low).force_gwt == pytest.approx(LOW_GWT)


def test_one_build_knows_what_separate_ones_know(slim: Fingertip) -> None:
    """Against a finger from the disk with receptors of its own: the row, the ten and the deep row."""
    ours, theirs = FingerAnswers(slim), FingerAnswers(load(slim.config))
    scene = deep("bar:3.0", 1.0)
    for one, other in zip(ours.beneath(scene, "sed"), theirs.beneath(scene, "sed"), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-8)
    assert apart(ours, doi_mm=1.33, depth_mm=2.5) == pytest.approx(apart(theirs, doi_mm=1.33, depth_mm=2.5), rel=1e-6)
    places = slim.model.receptors
    assert len(places.depths_mm) == len(ROW_X_MM) + len(DEFAULT_X_MM) + len(DEEP_X_MM)
    assert places.depths_mm.tolist() == [ROW_DEPTH_MM] * 29 + [DEFAULT_DEPTH_MM] * 10 + [2.5] * 23


def test_a_place_that_nobody_announced_is_refused(slim: Fingertip) -> None:
    source = slim._source
    assert isinstance(source, BuiltOnce)
    key = ALONG, None
    assert source.interior(key) is None
    known = slim.model.receptors.position_mm
    with pytest.raises(ReceptorError, match="a place that nobody announced"):
        source.columns(key, ReceptorSet(np.add(known[:2], [[0, 0, 0], [0, 1e-6, 0]]), np.zeros(2)))
    turned = source.columns(key, ReceptorSet(known[[3, 1]], np.zeros(2)))
    n = len(known)
    per_place = slim.model.columns.per_skin_force.reshape(n, -1)[[3, 1]]
    np.testing.assert_array_equal(turned.per_skin_force.reshape(2, -1), per_place)
    np.testing.assert_array_equal(turned.young_ratio, slim.model.columns.young_ratio[[3, 1]])


def test_a_pulp_too_thin_for_the_deep_row_goes_without() -> None:
    thin = finger({**DEFAULT, "bone_axis_mm": 0.6}, MESH)
    assert 2.5 not in thin.model.receptors.depths_mm
    assert math.isnan(one_finger._of(FingerAnswers(thin), lambda a: apart(a, doi_mm=1.33, depth_mm=2.5)))


def test_a_finger_answers_for_every_fact_and_one_that_fails_takes_no_other_with_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def made(values: Values, mesh: object) -> Fingertip:
        assert (values, mesh) == (SLIM, MESH)
        return finger(values, MESH)

    monkeypatch.setattr(one_finger, "finger", made)
    monkeypatch.setattr(
        one_finger, "SCENES", [deep("bar:3.0", 99.0)]
    )  # refused: all are pressed as they are asked for
    some = [f for f in FACTS if f.figure in ("4-1", "4-3", "ch. 3, geometry")]
    monkeypatch.setattr(one_finger, "FACTS", some)
    found = facts_of(SLIM, MESH)
    assert list(found) == [fact.key for fact in some]
    assert all(math.isfinite(value) for value in found.values())


@pytest.mark.parametrize("error", [RuntimeError, ValueError, ZeroDivisionError])
def test_a_fact_that_a_finger_does_not_give_is_no_number(slim: Fingertip, error: type[Exception]) -> None:
    def measure(_: FingerAnswers) -> float:
        raise error

    assert math.isnan(one_finger._of(FingerAnswers(slim), measure))
    assert one_finger._of(FingerAnswers(slim), lambda _: 2) == 2.0
