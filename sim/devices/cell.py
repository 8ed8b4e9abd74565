"""What a load cell and its amplifier make of a force before an instrument shows it."""

import math
from collections.abc import Callable

import numpy as np


def load_cell(
    force_n: Callable[[float], float],
    *,
    sample_period_s: float,
    noise_n: float = 0.0,
    latency_s: float = 0.0,
    seed: int = 0,
) -> Callable[[float], float]:
    """The force as the cell gives it, N at a time in s: late by latency_s, with Gaussian noise of each sample.

    Noise depends on the seed and the sample instant alone, so that it is the same however often, and in whatever
    order, samples are asked for. noise_n is its standard deviation.
    """

    def read_n(t_s: float) -> float:
        force = force_n(max(t_s - latency_s, 0.0))
        return force + noise_n * _standard_normal(seed, math.floor(t_s / sample_period_s + 1e-6))

    return read_n if noise_n or latency_s else force_n


def _standard_normal(seed: int, index: int) -> float:
    return float(np.random.default_rng((seed, max(index, 0))).standard_normal())
