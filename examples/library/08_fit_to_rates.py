"""Fit R = max(0, k (ε − ε₀)) to a recorded profile of discharge rates. The fit is `rig`'s, not the simulator's.

The rates here are made up by that very rule, with noise: put your own recording in their place.
"""

import numpy as np
from numpy.typing import NDArray

from rig.compare.fit import fit_rates, predicted
from sim import Fingertip, indent_many

Array = NDArray[np.float64]


def main(finger: Fingertip, positions: int = 25, receptor: int = 5, cores: int | None = None) -> tuple[float, float]:
    recorded_mm = np.linspace(-2.0, 2.0, positions)  # indentor minus receptive field
    found = indent_many(finger, "bar:1.5", recorded_mm, doi_mm=0.4, cores=cores)
    eps = np.array([result.receptor_measures["sed"][receptor] for result in found if result is not None])
    rate = synthetic_rates(eps)

    fit = fit_rates(eps, rate)
    r = np.corrcoef(rate, predicted(fit, eps))[0, 1]
    print(f"k = {fit.k:.3g} per pseudo-unit, ε₀ = {fit.eps0:.3g}, r = {r:.3f}, fires unloaded: {fit.fires_unloaded}")
    return float(fit.k), float(fit.eps0)


def synthetic_rates(eps: Array) -> Array:
    """SYNTHETIC, no recording: 80 per second where SED is highest, silent below a quarter of that."""
    threshold = 0.25 * eps.max()
    mean: Array = np.maximum(0.0, 80.0 * (eps - threshold) / (eps.max() - threshold))
    return np.random.default_rng(0).poisson(mean).astype(np.float64)


if __name__ == "__main__":
    main(Fingertip.load())
