"""Pressures as contacts may bear, drawn at random: what is known of them before any reading, of any size.

One contact, or two or three; ends anywhere, level and slow variation inside. At a sharp end, a corner's, pressure
rises as one over the root of the distance to it, by an amplitude that is unknown to a factor; ends of one contact
are more often alike than not.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

HOW_MANY = (0.2, 0.5, 0.3)
"""Probabilities of one, two and three contacts. Chosen on other scenes and seeds than those reported
(docs/coding.md), as all below."""

SHARP, ALIKE = 0.6, 0.6
"""Probabilities that an end is sharp, and that the last end is told to be as the first."""

_LEVEL_SD = 0.6  # of a contact's log level, beside others
_SLOW, _LENGTH_SAMPLES = 0.2, 4.0  # of the variation inside, over the level: sd and length (Matérn 5/2)
_PEAK, _PEAK_SD = 1.3, 0.8  # log amplitude of a sharp end over the level
_FADES_SAMPLES = 1.0
_NARROWEST = 0.7  # samples


def imagined(count: int, samples: int, seed: int = 0) -> Array:
    """(count, samples) none below 0; about 1 inside contacts."""
    rng = np.random.default_rng(seed)
    found = np.zeros((count, samples))
    several = rng.choice(len(HOW_MANY), count, p=HOW_MANY) + 1
    for contacts in range(1, len(HOW_MANY) + 1):
        at = np.flatnonzero(several == contacts)
        ends = np.sort(rng.uniform(0.0, samples, (len(at), 2 * contacts)), axis=1)
        for first, last in ends.reshape(len(at), contacts, 2).transpose(1, 2, 0):
            level = np.exp(_LEVEL_SD * rng.normal(size=(len(at), 1)))
            found[at] += level * _contact(first, np.maximum(last, first + _NARROWEST), samples, rng)
    return found


def _contact(first: Array, last: Array, samples: int, rng: np.random.Generator) -> Array:
    """(count, samples) of contacts between (count,) places, in samples."""
    number = np.arange(samples)
    covered = np.clip(np.minimum(number + 1, last[:, None]) - np.maximum(number, first[:, None]), 0.0, 1.0)
    apart = np.abs(np.subtract.outer(number, number)) * (np.sqrt(5) / _LENGTH_SAMPLES)
    alike = np.linalg.cholesky((1 + apart + apart**2 / 3) * np.exp(-apart) + 1e-6 * np.eye(samples))
    inside = np.maximum(0.0, 1 + _SLOW * rng.normal(size=covered.shape) @ alike.T)
    sharp = rng.random((2, len(first))) < SHARP
    sharp[1] = np.where(rng.random(len(first)) < ALIKE, sharp[0], sharp[1])
    peaks = np.zeros_like(covered)
    for is_sharp, from_end in zip(sharp, (number - first[:, None], last[:, None] - number - 1), strict=True):
        height = np.where(is_sharp, np.exp(_PEAK + _PEAK_SD * rng.normal(size=len(first))), 0.0)
        peaks += height[:, None] * _peak(from_end)
    return np.asarray(covered * inside + np.where(covered > 0, peaks, 0.0))


def _peak(from_end: Array) -> Array:
    """Mean of 1 / √distance over a sample that begins so far from the end, fading; in samples."""
    begins, ends = np.maximum(0.0, from_end), np.maximum(0.0, from_end + 1)
    return np.asarray(2 * (np.sqrt(ends) - np.sqrt(begins)) * np.exp(-begins / _FADES_SAMPLES))
