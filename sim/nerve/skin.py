"""Signals at receptors while an indentor moves over one place: a table of presses, linear for vibrations."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import PchipInterpolator

from sim.errors import ModelRangeError
from sim.models.fingertip import Fingertip
from sim.nerve.stimulus import Stimulus

Array = NDArray[np.float64]

LEVELS = 16
"""Number of presses in a table."""


@dataclass(frozen=True)
class Signal:
    """Measure at receptors on an even time grid, with its time derivatives.

    Attributes
    ----------
    step_s : float
        Time between samples (s).
    value, rate, acceleration : ndarray of shape (n_receptors, n_samples)
        The measure, its first and second derivative (1/s, 1/s²).
    """

    step_s: float
    value: Array
    rate: Array
    acceleration: Array


class PressedSkin:
    """A measure at receptors against the depth of an indentor over one place.

    The measure is interpolated between presses, monotonically between their values. A vibration adds the measure's
    slope at the depth without it, times the amplitude: contact is frozen (`frozen_mm` tells how far).

    Parameters
    ----------
    finger : Fingertip
        The finger.
    indentor : str
        Its shape, for example ``"bar:3.0"``.
    points_mm : array_like of shape (n_receptors, 3)
        Receptors in the undeformed finger (mm).
    measure : callable
        Maps the 18 measures at the receptors to the signal of shape (n_receptors,).
    deepest_mm : float
        Largest depth (mm).
    x_mm, z_mm : float, optional
        Place of the indentor (mm).
    """

    def __init__(
        self,
        finger: Fingertip,
        indentor: str,
        points_mm: ArrayLike,
        measure: Callable[[dict[str, Array]], Array],
        deepest_mm: float,
        x_mm: float = 0.0,
        z_mm: float | None = None,
    ) -> None:
        self.depths_mm = deepest_mm * np.linspace(0.0, 1.0, LEVELS + 1)[1:]
        finger = finger.keeping_ways()
        self.presses = [finger.indent(indentor, x_mm, z_mm=z_mm, doi_mm=float(d)) for d in self.depths_mm]
        fields = finger.fields(self.presses, np.asarray(points_mm, dtype=float))
        values = np.stack([measure(one.measures) for one in fields])
        self._value = PchipInterpolator(
            np.concatenate([[0.0], self.depths_mm]), np.concatenate([np.zeros((1, values.shape[1])), values])
        )
        self._slope, self._curvature = self._value.derivative(1), self._value.derivative(2)

    def signal(self, stimulus: Stimulus, step_s: float, lasts_s: float | None = None) -> Signal:
        """Return the signal of a stimulus from 0 s on.

        Parameters
        ----------
        stimulus : Stimulus
            Depth against time.
        step_s : float
            Time between samples (s).
        lasts_s : float, optional
            Duration (s). Default: that of the stimulus.

        Returns
        -------
        Signal
            The signal at all receptors.

        Raises
        ------
        ModelRangeError
            If the stimulus is deeper than the table.
        """
        if stimulus.deepest_mm > self.depths_mm[-1] * (1 + 1e-9):
            raise ModelRangeError(
                "DOI {doi_mm:g} mm: the table of presses ends at {deepest_mm:g} mm",
                code="doi_beyond_table",
                doi_mm=stimulus.deepest_mm,
                deepest_mm=float(self.depths_mm[-1]),
            )
        t = np.arange(0.0, stimulus.ends_s if lasts_s is None else lasts_s, step_s)
        depth = stimulus.depth_mm(t)
        touching = depth > 0
        depth = np.where(touching, depth, 0.0)
        speed = np.where(touching, stimulus.speed_mm_s(t), 0.0)
        acceleration = np.where(touching, stimulus.acceleration_mm_s2(t), 0.0)
        value, slope, curvature = (f(depth).T for f in (self._value, self._slope, self._curvature))
        wave = [np.where(touching, stimulus.vibration_mm(t, k), 0.0) for k in range(3)]
        return Signal(
            step_s,
            value + slope * wave[0],
            slope * (speed + wave[1]),
            curvature * speed**2 + slope * (acceleration + wave[2]),
        )
