"""Signals at receptors while an indentor moves over one place: a table of presses, read at every instant's depth."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import PchipInterpolator

from sim.errors import ModelRangeError
from sim.models.fingertip import Fingertip
from sim.models.result import IndentationResult
from sim.nerve.stimulus import Stimulus

Array = NDArray[np.float64]

LEVELS = 16
"""Number of presses in a table."""
SAMPLES_PER_CYCLE = 10
"""Smallest number of samples in a cycle of a vibration."""


@dataclass(frozen=True)
class Signal:
    """Measure at receptors on an even time grid: (n_receptors, n_samples) or (n_afferents, n_organs, n_samples)."""

    step_s: float
    value: Array


class SkinUnderIndentor:
    """A measure at receptors (n_receptors, 3) against the depth of an indentor over one place.

    The finger is quasi-static and elastic, so that the measure depends on the depth alone. It is interpolated between
    the presses of a table, monotonically and with a continuous slope: a vibration of some micrometers follows the
    slope at its preload, at any frequency and far below a contact solver's tolerance. `measure` maps the 18 measures
    to (n_receptors,); `presses` are those of `table_of_presses`, computed by default.
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
        presses: Sequence[IndentationResult] | None = None,
    ) -> None:
        if presses is None:
            presses = table_of_presses(finger, indentor, deepest_mm, x_mm, z_mm)
        fields = finger.fields(presses, np.asarray(points_mm, dtype=float))
        self._read([one.doi_mm for one in presses], np.stack([measure(one.measures) for one in fields]))

    @classmethod
    def of_values(cls, depths_mm: ArrayLike, values: ArrayLike) -> "SkinUnderIndentor":
        """Return a skin with a table: ascending depths above 0 (n_depths,), and values (n_depths, n_receptors)."""
        skin = cls.__new__(cls)
        skin._read(np.asarray(depths_mm, dtype=float), np.asarray(values, dtype=float))
        return skin

    def _read(self, depths_mm: ArrayLike, values: Array) -> None:
        self.depths_mm = np.array(depths_mm, dtype=float)
        self.value = PchipInterpolator(
            np.concatenate([[0.0], self.depths_mm]), np.concatenate([np.zeros((1, values.shape[1])), values])
        )

    def signal(self, stimulus: Stimulus, step_s: float, lasts_s: float | None = None) -> Signal:
        """Return the signal of a stimulus at all receptors from 0 s on, by default for its duration.

        Raises ModelRangeError if the stimulus is deeper than the table, or the step is too long for a vibration.
        """
        if stimulus.deepest_mm > self.depths_mm[-1] * (1 + 1e-9):
            raise ModelRangeError(
                f"depth {stimulus.deepest_mm:g} mm: the table of presses ends at {float(self.depths_mm[-1]):g} mm",
                "doi_beyond_table",
            )
        for one in stimulus.vibrations:
            if step_s * one.frequency_hz * SAMPLES_PER_CYCLE > 1 + 1e-9:
                raise ModelRangeError(
                    f"a step of {step_s:g} s under {one.frequency_hz:g} Hz: must be at most "
                    f"{1 / (SAMPLES_PER_CYCLE * one.frequency_hz):.2g} s, {SAMPLES_PER_CYCLE} samples in a cycle",
                    "step_too_long",
                )
        t = np.arange(0.0, stimulus.ends_s if lasts_s is None else lasts_s, step_s)
        depth = stimulus.depth_mm(t) + stimulus.vibration_mm(t)
        return Signal(step_s, np.ascontiguousarray(self.value(np.clip(depth, 0.0, self.depths_mm[-1])).T))


def table_of_presses(
    finger: Fingertip,
    indentor: str,
    deepest_mm: float,
    x_mm: float = 0.0,
    z_mm: float | None = None,
    levels: int = LEVELS,
) -> list[IndentationResult]:
    """Return presses at even depths over one place, the deepest last."""
    finger = finger.keeping_ways()
    depths_mm = deepest_mm * np.linspace(0.0, 1.0, levels + 1)[1:]
    return [finger.indent(indentor, x_mm, z_mm=z_mm, doi_mm=float(depth)) for depth in depths_mm]
