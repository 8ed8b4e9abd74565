"""Noise of what was recorded: counts, rates with an sd, rates alone; with repeats and without."""

import numpy as np
import pytest
from numpy.typing import NDArray

from rig.compare.likelihood import Observed, observed
from rig.compare.recordings.recording import Recording, recording

Array = NDArray[np.float64]


def recorded(rates: Array, window_s: float | None = None, sd: float = np.nan) -> Recording:
    """(p, presses) rates, 0.5 mm apart."""
    rows = [(0.5 * n, float(rate), sd) for n, row in enumerate(rates) for rate in row]
    return recording("x.csv", rows, window_s)


def all_of(*recordings: Recording) -> Observed:
    return observed(recordings, np.ones(sum(len(one.rate) for one in recordings), dtype=bool))


def poisson(mean: float, presses: int, window_s: float, places: int = 400) -> Array:
    return np.random.default_rng(0).poisson(mean * window_s, size=(places, presses)) / window_s


def test_the_kind_is_the_most_that_every_recording_knows() -> None:
    rates, other = poisson(9, 1, 1.0, 5), poisson(9, 2, 1.0, 5)
    assert all_of(recorded(rates, 1.0), recorded(rates, 0.5)).kind == "counts"
    assert all_of(recorded(rates, 1.0), recorded(rates)).kind == "rates"
    assert all_of(recorded(rates, sd=2.0)).kind == "sd"
    assert all_of(recorded(other, sd=2.0)).kind == "rates"  # repeats say it themselves
    assert all_of(recorded(rates, sd=2.0), recorded(rates)).kind == "rates"


def test_what_is_observed_at_each_position() -> None:
    found = all_of(recorded(np.array([[2.0, 4.0], [0.0, 0.0], [8.0, 9.0]]), 0.5), recorded(np.ones((3, 1)), 2.0))
    np.testing.assert_array_equal(found.stimulus, [0, 0, 0, 1, 1, 1])
    np.testing.assert_array_equal(found.rate, [3, 0, 8.5, 1, 1, 1])
    np.testing.assert_array_equal(found.within, [2, 0, 0.5, 0, 0, 0])
    np.testing.assert_array_equal(found.exposure_s, [1, 1, 1, 2, 2, 2])
    some = found.at(np.array([False, True, True, False, False, False]))
    np.testing.assert_array_equal(some.rate, [0, 8.5])


def test_positions_that_are_not_known_are_left_out() -> None:
    found = observed([recorded(np.array([[1.0], [2.0], [3.0]]), 1.0)], np.array([True, False, True]))
    np.testing.assert_array_equal(found.rate, [1, 3])
    np.testing.assert_array_equal(found.position_mm, [0, 1])


@pytest.mark.parametrize("presses", [2, 5])
def test_poisson_s_dispersion_is_one_whatever_the_window(presses: int) -> None:
    for window_s in (0.5, 2.0):
        noise = all_of(recorded(poisson(10, presses, window_s), window_s)).noise
        assert noise.dispersion == pytest.approx(1.0, abs=4 * np.sqrt(2 / 400 / (presses - 1)))
        assert (noise.kind, noise.source) == ("counts", "repeats")
        assert noise.freedom == pytest.approx(400 * (presses - 1), rel=0.1)


def test_regular_and_irregular_counts() -> None:
    """Binomial of chance 0.7 has 0.3 of Poisson's variance, a negative binomial of chance 1/3 three times it."""
    rng = np.random.default_rng(1)
    regular, irregular = rng.binomial(30, 0.7, size=(300, 4)), rng.negative_binomial(10, 1 / 3, size=(300, 4))
    assert all_of(recorded(regular * 1.0, 1.0)).noise.dispersion == pytest.approx(0.3, abs=0.05)
    assert all_of(recorded(irregular * 1.0, 1.0)).noise.dispersion == pytest.approx(3.0, abs=0.5)


def test_rates_alone_have_one_variance() -> None:
    noise = all_of(recorded(np.array([[1.0, 3.0], [4.0, 4.0], [0.0, 4.0]]))).noise
    assert noise == ("rates", "repeats", (2 + 0 + 8) / 3, 3.0)


def test_rates_with_an_sd_are_believed() -> None:
    rows = [(0.0, 1.0, 0.0), (1.0, 2.0, 0.5), (2.0, 3.0, 2.0)]
    found = all_of(recording("x", rows))
    assert found.noise == ("sd", "sd", 1.0, np.inf)
    np.testing.assert_allclose(found.variance(found.rate), [0.25, 0.25, 4.0])  # none is exact
    np.testing.assert_allclose(found.deviance(found.rate + 1), [4, 4, 0.25])


def test_without_repeats_neighbours_say_how_large_the_noise_is() -> None:
    """White noise on a line, which has no curvature; 400 positions."""
    rng = np.random.default_rng(2)
    rates = 100 + 0.5 * np.arange(400) + rng.normal(scale=3, size=400)
    noise = all_of(recorded(rates[:, None])).noise
    assert noise.dispersion == pytest.approx(9.0, rel=0.3)
    assert (noise.source, noise.freedom) == ("neighbours", pytest.approx(398 * 18 / 35))
    counted = all_of(recorded(rng.poisson(40, size=(400, 1)) / 2.0, 2.0)).noise
    assert counted.dispersion == pytest.approx(1.0, abs=0.25)


def test_neighbours_are_of_one_stimulus() -> None:
    """Two flat rows at different levels, unevenly spaced ramps: no noise at all."""
    flat = all_of(recorded(np.full((4, 1), 9.0)), recorded(np.full((4, 1), 80.0)))
    assert flat.noise.dispersion == pytest.approx(1e-6 * 80**2)
    uneven = recording("x", [(x, 10 * x, np.nan) for x in (0.0, 0.1, 0.7, 0.9, 2.0)])
    assert all_of(uneven).noise.dispersion == pytest.approx(1e-6 * 20**2)


def test_a_spike_where_silence_is_expected_costs_much_but_not_all() -> None:
    """Half a spike is added to both: 2 (1.5 ln 3 − 1) for one spike, and nothing for none."""
    found = all_of(recorded(np.array([[1.0], [0.0], [4.0]]), 1.0))
    expected = [2 * (1.5 * np.log(3) - 1), 0.0, 0.0]
    np.testing.assert_allclose(found.deviance(np.array([0.0, 0.0, 4.0])), expected, atol=1e-12)
    np.testing.assert_allclose(found.variance(np.array([0.0, 0.0, 4.0])), [0.5, 0.5, 4.5])
    np.testing.assert_allclose(found.share(np.array([0.0, 0.5, 4.5])), [0, 0.5, 0.9])


def test_silent_positions_count_for_nothing() -> None:
    counts = np.concatenate([np.full((50, 3), 0.0), poisson(50, 3, 1.0, 50)])
    assert all_of(recorded(counts, 1.0)).noise.freedom == pytest.approx(100, rel=0.01)


def test_evenness_falls_where_the_noise_differs_between_positions() -> None:
    rng = np.random.default_rng(3)
    even = all_of(recorded(50 + rng.normal(size=(200, 5)))).evenness
    half = all_of(recorded(50 + rng.normal(size=(200, 5)) * np.repeat([[1.0], [0.0]], 100, axis=0))).evenness
    assert even == pytest.approx(1.0, abs=0.1)
    assert half == pytest.approx(0.5, abs=0.1)
    assert all_of(recorded(poisson(50, 5, 1.0, 20), 1.0)).evenness == 1.0


def test_smoothing_stays_within_a_stimulus() -> None:
    found = all_of(recorded(np.array([[0.0], [3.0], [6.0]])), recorded(np.array([[90.0], [90.0], [60.0]])))
    np.testing.assert_allclose(found.smooth, [1.5, 3, 4.5, 90, 80, 75])
