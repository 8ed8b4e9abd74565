"""The model confidence set: what it holds, and how often."""

import numpy as np

from rig.compare.model_confidence_set import BLOCK, DRAWS, resampled, set_probabilities

ONE = np.zeros(40, dtype=np.int64)


def test_each_draw_has_as_many_positions_of_each_stimulus() -> None:
    stimulus = np.repeat([0, 1], [9, 14])
    drawn = resampled(stimulus)
    assert drawn.shape == (DRAWS, 23)
    np.testing.assert_array_equal(drawn[:, :9].sum(axis=1), 9)
    np.testing.assert_array_equal(drawn[:, 9:].sum(axis=1), 14)
    np.testing.assert_allclose(drawn.mean(axis=0), 1, atol=0.35)
    np.testing.assert_array_equal(drawn, resampled(stimulus))


def test_neighbours_are_drawn_together() -> None:
    """In circular blocks of four, three of four neighbours come along."""
    drawn = resampled(ONE) > 0
    together = (drawn & np.roll(drawn, 1, axis=1)).mean()
    assert BLOCK == 4
    assert together > 1.2 * drawn.mean() ** 2


def test_what_is_clearly_worse_goes_and_what_is_alike_stays() -> None:
    rng = np.random.default_rng(0)
    base = rng.exponential(size=40)
    loss = np.stack([base, base + 0.01 * rng.normal(size=40), base + 2 + 0.1 * rng.random(40), base])
    p = set_probabilities(loss, ONE)
    assert p[2] < 0.01
    assert (p[[0, 1, 3]] > 0.05).all()
    assert p.max() == 1


def test_two_that_are_the_same_both_stay() -> None:
    loss = np.tile(np.random.default_rng(1).exponential(size=40), (2, 1))
    np.testing.assert_array_equal(set_probabilities(loss, ONE), [1, 1])


def test_a_difference_far_below_the_noise_is_none_however_regular() -> None:
    """A hundredth in each of 40 positions is 0.4 in all, below 0.5; two hundredths are more."""
    base = np.random.default_rng(2).exponential(size=40)
    assert set_probabilities(np.stack([base, base + 0.01]), ONE).min() > 0.05
    assert set_probabilities(np.stack([base, base + 0.02]), ONE).min() < 0.05


def test_the_best_of_many_stays_in_19_of_20() -> None:
    """Twelve of nearly equal expected loss; 300 draws, of which 95 % have a standard error of 1.3 %."""
    rng = np.random.default_rng(3)
    extra = 0.05 * np.arange(12)
    kept = sum(set_probabilities(rng.exponential(size=(12, 40)) + extra[:, None], ONE)[0] >= 0.05 for _ in range(300))
    assert kept / 300 > 0.91
