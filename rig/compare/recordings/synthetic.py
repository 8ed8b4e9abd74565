"""Synthetic recordings, for demonstrations and for testing the statistics. They are not data.

Rule: at each position the mean rate is max(0, k(ε − ε₀)), ε the SSRP of a chosen measure at a chosen receptor; each
repeat counts spikes in a window, Poisson with that mean, and the rate is the count over the window.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.compare.recordings.recording import Recording, recording
from rig.compare.stimuli import StimulusRow
from rig.data.folder import replace_text
from sim.measures.measures import MEASURES

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LinearAfferent:
    """Synthetic afferent with R = max(0, k(ε − ε₀)) in 1/s; ε₀ has the sign and unit of the measure's profile."""

    measure: str
    receptor: int
    k: float
    eps0: float

    def rate(self, stimulus: StimulusRow, position_mm: Array) -> Array:
        """Return the mean rates (p,); NaN at positions that the run does not cover."""
        eps = stimulus.at(position_mm)[MEASURES.index(self.measure), :, self.receptor]
        return np.maximum(0.0, self.k * (eps - self.eps0))


def afferent_for(
    stimuli: list[StimulusRow], measure: str, receptor: int, peak: float, silent: float
) -> LinearAfferent:
    """Return an afferent that fires at `peak` at the largest ε of the stimuli, and not below a share `silent` of its
    range.
    """
    values = np.concatenate([stimulus.ssrp(measure, receptor) for stimulus in stimuli])
    eps0 = float(values.min() + silent * np.ptp(values))
    return LinearAfferent(measure, receptor, peak / (float(values.max()) - eps0), eps0)


def record(
    afferent: LinearAfferent,
    stimulus: StimulusRow,
    position_mm: Array,
    rng: np.random.Generator,
    repeats: int = 5,
    window_s: float = 1.0,
) -> Recording:
    """Return a synthetic recording at the positions (p,) that the run covers."""
    mean = afferent.rate(stimulus, position_mm)
    covered = np.isfinite(mean)
    counts = rng.poisson(window_s * mean[covered], size=(repeats, int(covered.sum())))
    places = np.asarray(position_mm)[covered]
    rows = [(float(x), float(n) / window_s, np.nan) for column in counts for x, n in zip(places, column, strict=True)]
    return replace(recording(_file_name(afferent, stimulus), rows, window_s), changes=("synthetic",))


def write_synthetic(folder: Path, found: Recording) -> Path:
    """Write a synthetic recording as the CSV that `rig compare` reads; its name begins with "synthetic"."""
    lines = ["position_mm,rate,repeat"]
    for x, rates in zip(found.position_mm, found.repeats, strict=True):
        lines += [f"{x:.4f},{rate:.4f},{number}" for number, rate in enumerate(rates, 1)]
    path = folder / found.name
    replace_text(path, "\n".join(lines) + "\n")
    return path


def _file_name(afferent: LinearAfferent, stimulus: StimulusRow) -> str:
    shape = stimulus.shape.replace(":", "").replace(",", "-")
    x = f"{round(float(stimulus.receptor_mm[afferent.receptor]), 2) + 0.0:g}"
    return f"synthetic_{shape}_{stimulus.condition.replace(' ', '')}_{afferent.measure}_at_{x}.csv"
