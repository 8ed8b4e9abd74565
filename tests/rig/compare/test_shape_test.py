"""The shape test, on profiles drawn by hand and on properties that any such test must have."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from rig.compare.profile_shape_test import shape_test

Array = NDArray[np.float64]


def bump(x: Array, centre: float, width: float) -> Array:
    return np.exp(-(((x - centre) / width) ** 2))


def passed(shape: str, profile: Array | list[float], threshold: float = 0.05) -> bool:
    """The verdict on values in order of motion (x decreasing)."""
    values = np.array(profile, dtype=float)
    verdict = shape_test(shape, -np.arange(len(values), dtype=float), values, threshold)
    assert verdict is not None
    return verdict.passed


# b = 1 in all of them, and the peak stands at 2 where nothing else is said: p = 1.
@pytest.mark.parametrize(
    ("profile", "expected"),
    [
        ([1, 1.5, 2, 1, 0.6, 0.9, 1], True),  # peak, smaller dip, recovery
        ([1, 1.1, 1, 0.5, 0.2, 0.6, 1], False),  # dip deeper than the peak is high
        ([1, 1.5, 2, 1.5, 1.2, 1, 1], False),  # no dip
        ([1, 1, 0.9, 0.5, 0.9, 1, 1], False),  # no peak
        ([1, 1.5, 2, 1, 0.96, 1, 1], False),  # a dip of 4 %
        ([1, 1.5, 2, 1, 0.94, 1, 1], True),  # a dip of 6 %
        ([1, 0.9, 0.6, 1, 2, 1.5, 1], False),  # dip before the peak: the mirrored profile
        ([1.4, 2, 1.5, 1, 0.8, 0.6, 0.6], False),  # never recovers
        ([1.2, 2, 1.5, 1, 0.6, 0.7, 0.8], True),  # recovers exactly half of q = 0.4
        ([1.2, 2, 1.5, 1, 0.6, 0.7, 0.7], False),  # q = 0.35, recovers 0.1
        ([1.2, 2, 1.5, 1, 0.6, 0.7, 0.76], False),  # q = 0.38, recovers 0.16: not quite half
        ([1, 1, 1, 1, 1, 1, 1], False),  # nothing at all
    ],
)
def test_steps_drawn_by_hand(profile: list[float], expected: bool) -> None:
    assert passed("step:1", profile) is expected


@pytest.mark.parametrize(
    ("profile", "expected"),
    [
        ([0, 0.5, 1, 0.8, 0.9, 0.4, 0], True),  # 1.0 and 0.9 over 0.8: prominences 1.0 and 0.1 of a range of 1
        ([0, 0.5, 1, 0.86, 0.9, 0.4, 0], False),  # the second stands out by 4 %
        ([0, 0.5, 1, 0.84, 0.9, 0.4, 0], True),  # by 6 %
        ([0, 0.5, 1, 1.1, 1, 0.5, 0], False),  # one maximum
        ([1, 0.5, 0.2, 0.1, 0.2, 0.5, 1], False),  # the ends of the schedule are not maxima
        ([0, 0.5, 1, 0.7, 0.8, 0.9, 1], False),  # the second maximum was not reached
        ([0, 1, 0.5, 1, 0.5, 1, 0], True),  # three maxima: two of them flank a minimum
        ([0, 0, 0, 0, 0, 0, 0], False),
        ([0, 0.5, 1, 1, 0.6, 0.9, 0], True),  # a flat top is one maximum
    ],
)
def test_bars_drawn_by_hand(profile: list[float], expected: bool) -> None:
    assert passed("bar:3.0", profile) is expected


profiles = st.lists(st.integers(-50, 50), min_size=5, max_size=30).map(lambda v: np.array(v, dtype=float))
shapes = st.sampled_from(["step:1", "bar:3.0"])


@given(shapes, profiles, st.randoms())
def test_the_order_in_which_positions_are_given_does_not_matter(shape: str, profile: Array, random: object) -> None:
    x = np.linspace(2, -3, len(profile))
    order = np.array(random.sample(range(len(profile)), len(profile)))  # type: ignore[attr-defined]
    assert shape_test(shape, x[order], profile[order]) == shape_test(shape, x, profile)


@given(shapes, profiles, st.sampled_from([0.25, 2.0, 1024.0]), st.integers(-1000, 1000))
def test_scale_and_offset_do_not_matter(shape: str, profile: Array, scale: float, offset: int) -> None:
    # Powers of two and whole numbers, so that the arithmetic is exact and a tie stays a tie.
    assert passed(shape, scale * profile + offset) == passed(shape, profile)


@given(profiles)
def test_a_bar_passes_in_either_direction(profile: Array) -> None:
    assert passed("bar:3.0", profile[::-1]) == passed("bar:3.0", profile)


@given(profiles)
def test_a_step_never_passes_without_a_dip_or_without_a_peak(profile: Array) -> None:
    lowest, highest = sorted((profile[0], profile[-1]))
    assert not passed("step:1", np.maximum(profile, highest))
    assert not passed("step:1", np.minimum(profile, lowest))


@given(shapes, profiles, st.floats(0.0, 0.5), st.floats(0.0, 0.5))
def test_a_stricter_threshold_passes_less(shape: str, profile: Array, one: float, other: float) -> None:
    if passed(shape, profile, max(one, other)):
        assert passed(shape, profile, min(one, other))


@given(st.floats(0.1, 0.9), st.floats(0.3, 1.0))
def test_smooth_steps(depth: float, width: float) -> None:
    """A peak of 1 and a dip of `depth` 2.5 mm later on a flat base, moved from + to −, pass; mirrored they do not."""
    x = np.arange(4, -4, -0.17)
    profile = 3 + bump(x, 1.0, width) - depth * bump(x, -1.5, width)
    assert passed("step:3", profile)
    assert not passed("step:3", profile[::-1])
