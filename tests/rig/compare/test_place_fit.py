"""The place of a receptor, on measures that are known at every place."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from rig.compare.comparison import Overlay, compare
from rig.compare.exceptions import ComparisonError
from rig.compare.likelihood import Form
from rig.compare.place_grid import PlaceRange, PlaceRow, ReceptorLocation
from rig.compare.receptor_place import receptor_location
from rig.compare.recordings.recording import recording
from rig.compare.stimuli import StimulusRow
from tests.error_codes import raises

Array = NDArray[np.float64]
Laid = Callable[..., Sequence[Overlay]]

WHERE = PlaceRange((-1.0, 1.0), (0.5, 1.1))
WITH_OFFSET = WHERE._replace(offset_mm=(-0.3, 0.3))
PRESSED = np.arange(-4.0, 4.01, 0.05)
POSITIONS = np.arange(-2.0, 2.01, 0.1)


def response(indentor_mm: Array, x_mm: Array | float, depth_mm: Array | float) -> Array:
    """Wider with depth; with a second peak beside the first that grows with x."""
    away = indentor_mm - x_mm
    return np.exp(-((away / (0.4 + depth_mm)) ** 2)) + (0.5 + 0.3 * np.asarray(x_mm)) * np.exp(
        -((away - 1.2) ** 2) / 0.1
    )


@pytest.fixture
def laid(make_stimulus: Callable[..., StimulusRow]) -> Laid:
    """Rates by `response` at a place, ± an sd, over a stimulus with receptors at every node of a range."""

    def make(
        x_mm: float,
        depth_mm: float,
        where: PlaceRange = WHERE,
        offset_mm: float = 0.0,
        sd: float = 0.01,
        pressed: Array = PRESSED,
        rng: np.random.Generator | None = None,
    ) -> Sequence[Overlay]:
        depth, x = (v.ravel() for v in np.meshgrid(where.depth_nodes, where.x_nodes, indexing="ij"))
        profile = response(pressed[:, None], x, depth)
        stimulus = make_stimulus("step:1", pressed, x, {"ep1": profile, "sed": profile[::-1]})
        rates = 2 * response(POSITIONS + offset_mm + x_mm, x_mm, depth_mm)
        rates = rates if rng is None else rates + sd * rng.standard_normal(len(rates))
        rows = [(float(p), max(float(rate), 0.0), sd) for p, rate in zip(POSITIONS, rates, strict=True)]
        return compare([stimulus], {"step:1": recording("mine.csv", rows)}).overlays

    return make


def row_of(found: ReceptorLocation | None, measure: str = "ep1") -> PlaceRow:
    assert found is not None
    return next(row for row in found.rows if row.measure == measure)


@pytest.mark.parametrize(("x_mm", "depth_mm"), [(-0.63, 0.62), (0.17, 0.88), (0.6, 1.03)])
def test_the_place_is_found_between_nodes(laid: Laid, x_mm: float, depth_mm: float) -> None:
    found = receptor_location(laid(x_mm, depth_mm), WHERE, Form(), ("sed", "ep1"))
    row = row_of(found)
    assert found is not None
    assert found.rows[0] is row
    assert row.x_mm == pytest.approx(x_mm, abs=0.02)
    assert row.depth_mm == pytest.approx(depth_mm, abs=0.01)
    assert row.x_interval[0] < x_mm < row.x_interval[1]
    assert row.depth_interval[0] < depth_mm < row.depth_interval[1]
    assert np.ptp(row.x_interval) < 0.2
    assert (row.offset_mm, row.offset_interval) == (0.0, (0.0, 0.0))
    assert (row.at_bounds, row.fits) == ((), True)
    assert row.k == pytest.approx(2, rel=0.02)
    assert not row_of(found, "sed").fits


def test_intervals_hold_the_truth_as_often_as_they_say(laid: Laid) -> None:
    """Of 30 draws at 95 %, fewer than 24 have a probability of 0.1 %."""
    rng = np.random.default_rng(3)
    held = []
    for _ in range(30):
        row = row_of(receptor_location(laid(0.13, 0.84, sd=0.05, rng=rng), WHERE, Form(), ("ep1",)))
        held.append(
            (row.x_interval[0] < 0.13 < row.x_interval[1], row.depth_interval[0] < 0.84 < row.depth_interval[1])
        )
    assert (np.sum(held, axis=0) >= 24).all()


def test_intervals_are_as_wide_as_the_noise(laid: Laid) -> None:
    narrow, wide = (
        row_of(receptor_location(laid(0.13, 0.84, sd=sd), WHERE, Form(), ("ep1",))) for sd in (0.01, 0.02)
    )
    for interval in ("x_interval", "depth_interval"):
        ratio = np.ptp(getattr(wide, interval)) / np.ptp(getattr(narrow, interval))
        assert ratio == pytest.approx(2, rel=0.25)


def test_a_bound_that_binds_is_told(laid: Laid) -> None:
    deep = row_of(receptor_location(laid(0.1, 1.25), WHERE, Form(), ("ep1",)))
    assert deep.depth_interval[1] == 1.1
    assert deep.at_bounds == ("depth high",)
    shallow = row_of(receptor_location(laid(-1.3, 0.4), WHERE, Form(), ("ep1",)))
    assert shallow.at_bounds == ("x low", "depth low")
    assert shallow.depth_interval[0] == 0.5
    assert shallow.x_interval[0] == -1.0


def test_an_offset_is_found_where_it_is_asked_for(laid: Laid) -> None:
    overlays = laid(0.2, 0.8, offset_mm=0.12, sd=0.03)
    row = row_of(receptor_location(overlays, WITH_OFFSET, Form(), ("ep1",)))
    assert row.offset_mm == pytest.approx(0.12, abs=0.01)
    assert row.offset_interval[0] < 0.12 < row.offset_interval[1]
    assert row.x_mm == pytest.approx(0.2, abs=0.05)
    assert row.fits
    assert row.at_bounds == ()
    without = row_of(receptor_location(overlays, WHERE, Form(), ("ep1",)))
    assert not without.fits
    assert without.offset_mm == 0.0
    beyond = row_of(receptor_location(laid(0.2, 0.8, offset_mm=0.4), WITH_OFFSET, Form(), ("ep1",)))
    assert "offset high" in beyond.at_bounds


def test_only_what_the_run_covers_counts(laid: Laid) -> None:
    """Pressed up to 2.2 mm: receptors beyond 0.2 mm miss some positions, but no more than a fifth."""
    found = receptor_location(laid(-0.4, 0.8, pressed=np.arange(-3.0, 2.21, 0.05)), WHERE, Form(), ("ep1",))
    assert found is not None
    assert found.requested == WHERE
    assert found.where.x_mm == pytest.approx((-1.0, 1.0))
    assert (found.positions, found.recorded) == (33, 41)
    narrower = receptor_location(laid(-0.4, 0.8, pressed=np.arange(-3.0, 1.41, 0.05)), WHERE, Form(), ("ep1",))
    assert narrower is not None
    assert narrower.where.x_mm == pytest.approx((-1.0, 0.125))
    assert row_of(narrower).x_mm == pytest.approx(-0.4, abs=0.03)
    with_offset = receptor_location(
        laid(-0.4, 0.8, WITH_OFFSET, pressed=np.arange(-3.0, 1.41, 0.05)), WITH_OFFSET, Form(), ("ep1",)
    )
    assert with_offset is not None
    assert with_offset.where.x_mm[1] < 0.0
    assert receptor_location(laid(0.0, 0.8, pressed=np.array([0.0, 0.1])), WHERE, Form()) is None
    with raises(ComparisonError, "offset_not_covered"):
        receptor_location(laid(0.0, 0.8, pressed=np.array([0.0, 0.1])), WITH_OFFSET, Form())


def test_an_afferent_that_hardly_fired_has_no_place(laid: Laid) -> None:
    (overlay,) = laid(0.2, 0.7)
    rows = [(float(x), 0.0, 0.01) for x in POSITIONS]
    assert (
        receptor_location([replace(overlay, recording=recording("mine.csv", rows))], WHERE, Form(), ("ep1",)) is None
    )
