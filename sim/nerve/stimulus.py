"""Depth of an indentor against time: ramps with rounded corners, and vibrations."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim.errors import ArgumentError, refuse_unless_numbers
from sim.tables import numbers_of

Array = NDArray[np.float64]

CORNER_S = 0.01
"""Default time in which a stage changes its speed (s). An instantaneous change would be an infinite acceleration."""


@dataclass(frozen=True)
class Vibration:
    """Sine added to the depth; its amplitude is zero to peak."""

    frequency_hz: float
    amplitude_um: float
    begins_s: float
    lasts_s: float


class Stimulus:
    """Depth of an indentor against time: straight pieces with rounded corners, and vibrations.

    Parameters
    ----------
    times_s, depths_mm : sequence of float
        Corners of the depth past first touch; a depth of 0 or less is out of contact. The first and last depth last.
    corner_s : float, optional
        Time in which the speed changes at a corner (s), at constant acceleration. Default: `CORNER_S`.
    vibrations : sequence of Vibration, optional
        Sines that are added.

    Raises
    ------
    ArgumentError
        If the times do not ascend, a number is not finite, or a vibration has no frequency.
    """

    def __init__(
        self,
        times_s: Sequence[float],
        depths_mm: Sequence[float],
        *,
        corner_s: float = CORNER_S,
        vibrations: Sequence[Vibration] = (),
    ) -> None:
        refuse_unless_numbers(corner_s=corner_s)
        self.times_s = np.array(numbers_of("times_s", times_s))
        self.depths_mm = np.array(numbers_of("depths_mm", depths_mm))
        self.corner_s, self.vibrations = corner_s, tuple(vibrations)
        if not (len(self.times_s) == len(self.depths_mm) > 0 and np.isfinite(self.depths_mm).all()):
            raise ArgumentError("a stimulus needs as many finite depths as times", "bad_stimulus")
        if not (np.isfinite(self.times_s).all() and (np.diff(self.times_s) > 0).all() and corner_s > 0):
            raise ArgumentError("the times of a stimulus must ascend", "bad_stimulus")
        for one in self.vibrations:
            refuse_unless_numbers(**vars(one))
            if not (0 < one.frequency_hz < np.inf and 0 <= one.amplitude_um < np.inf and 0 < one.lasts_s < np.inf):
                raise ArgumentError(
                    f"a vibration of {one.frequency_hz:g} Hz, {one.amplitude_um:g} µm for {one.lasts_s:g} s: "
                    "frequency and duration must be more than 0, the amplitude at least 0",
                    "bad_vibration",
                )

    @classmethod
    def ramp(
        cls,
        doi_mm: float,
        speed_mm_s: float,
        hold_s: float,
        *,
        begins_s: float = 0.1,
        away_mm: float = 0.5,
        corner_s: float = CORNER_S,
        vibrations: Sequence[Vibration] = (),
    ) -> "Stimulus":
        """Return a ramp-and-hold from above the skin to a depth, and back at the same speed.

        Parameters
        ----------
        doi_mm : float
            Depth of indentation (mm).
        speed_mm_s : float
            Speed of both ramps (mm/s).
        hold_s : float
            Duration of the hold (s).
        begins_s : float, optional
            Time of first touch (s).
        away_mm : float, optional
            Height above the skin before and after (mm).
        corner_s : float, optional
            Time in which the speed changes (s).
        vibrations : sequence of Vibration, optional
            Sines that are added.

        Returns
        -------
        Stimulus
            The stimulus.
        """
        refuse_unless_numbers(doi_mm=doi_mm, speed_mm_s=speed_mm_s, hold_s=hold_s, begins_s=begins_s, away_mm=away_mm)
        down_s, away_s = doi_mm / speed_mm_s, away_mm / speed_mm_s
        times = np.cumsum([begins_s - away_s, away_s + down_s, hold_s, down_s + away_s])
        return cls(times.tolist(), [-away_mm, doi_mm, doi_mm, -away_mm], corner_s=corner_s, vibrations=vibrations)

    @property
    def ends_s(self) -> float:
        """Time after which nothing changes (s)."""
        return max(
            0.0, float(self.times_s[-1]) + self.corner_s, *(one.begins_s + one.lasts_s for one in self.vibrations)
        )

    @property
    def deepest_mm(self) -> float:
        """Largest depth (mm), with the amplitudes of all vibrations."""
        return float(self.depths_mm.max()) + 1e-3 * sum(one.amplitude_um for one in self.vibrations)

    def depth_mm(self, t_s: ArrayLike) -> Array:
        """Return depths at times (mm), vibrations apart: means over the corner's time."""
        t, half = np.asarray(t_s, dtype=float), 0.5 * self.corner_s
        return np.asarray((self._area(t + half) - self._area(t - half)) / self.corner_s)

    def vibration_mm(self, t_s: ArrayLike) -> Array:
        """Return the vibrations' part of the depth at times (mm)."""
        t = np.asarray(t_s, dtype=float)
        total = np.zeros(t.shape)
        for one in self.vibrations:
            since = t - one.begins_s
            wave = 1e-3 * one.amplitude_um * np.sin(2 * np.pi * one.frequency_hz * since)
            total += np.where((since >= 0) & (since < one.lasts_s), wave, 0.0)
        return total

    def _area(self, t_s: Array) -> Array:
        """Return ∫ depth dt from the first corner."""
        t, d = self.times_s, self.depths_mm
        areas = np.concatenate([[0.0], np.cumsum(np.diff(t) * (d[1:] + d[:-1]) / 2)])
        piece = np.clip(np.searchsorted(t, t_s, side="right") - 1, 0, len(t) - 1)
        since = t_s - t[piece]
        slopes = np.append(np.diff(d) / np.diff(t), 0.0)
        return np.asarray(areas[piece] + since * d[piece] + np.where(since > 0, slopes[piece], 0.0) * since**2 / 2)
