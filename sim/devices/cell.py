"""What stands on a load cell: a force, what the cell makes of it, and the samples that an instrument takes."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sim.config.units import GWT_N
from sim.devices.clock import Scheduler, sample_at

_SAMPLES_KEPT = 256


def _always(_t_s: float) -> bool:
    return True


@dataclass(frozen=True)
class Load:
    """What stands on a force sensor: N at an instant in s, and whether that is known or the last one before."""

    force_n: Callable[[float], float]
    fresh: Callable[[float], bool] = _always


class Samples:
    """A load in grams on a fixed grid of instants; only those are taken that somebody asks about."""

    def __init__(self, scheduler: Scheduler, load: Load, period_s: float) -> None:
        self._scheduler, self._load, self._period_s = scheduler, load, period_s
        self._grams: dict[int, float] = {}

    def newest(self) -> int:
        """The number of the last sample by now."""
        return sample_at(self._scheduler.monotonic_s(), self._period_s)

    def next_s(self) -> float:
        """The instant of the sample after the newest."""
        return (self.newest() + 1) * self._period_s

    def grams(self, number: int) -> float:
        """One sample; not a number from a dead cell."""
        grams = self._grams.get(number)
        if grams is None:
            if len(self._grams) >= _SAMPLES_KEPT:
                self._grams.clear()
            grams = self._grams[number] = self._load.force_n(self._instant_s(number)) / GWT_N
        return grams

    def steady(self, number: int, count: int, band_g: float) -> bool:
        """Whether `count` samples up to this one are fresh and lie within a band."""
        numbers = range(number - count + 1, number + 1)
        if not all(self._load.fresh(self._instant_s(k)) for k in numbers):
            return False
        recent = [self.grams(k) for k in numbers]
        return max(recent) - min(recent) <= band_g

    def _instant_s(self, number: int) -> float:
        return max(number, 0) * self._period_s


def load_cell(
    force_n: Callable[[float], float],
    *,
    sample_period_s: float,
    noise_n: float = 0.0,
    latency_s: float = 0.0,
    drift_n_per_s: float = 0.0,
    seed: int = 0,
) -> Callable[[float], float]:
    """The force as the cell gives it, N at a time in s: late by latency_s, drifting, with Gaussian noise.

    Noise depends on the seed and the sample instant alone, so that it is the same however often, and in whatever
    order, samples are asked for. noise_n is its standard deviation.
    """

    def read_n(t_s: float) -> float:
        force = force_n(max(t_s - latency_s, 0.0)) + drift_n_per_s * t_s
        return force + noise_n * _standard_normal(seed, sample_at(t_s, sample_period_s))

    return read_n if noise_n or latency_s or drift_n_per_s else force_n


def _standard_normal(seed: int, index: int) -> float:
    return float(np.random.default_rng((seed, max(index, 0))).standard_normal())
