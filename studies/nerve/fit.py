"""Fit the gain of each class, SED₀, to its row of tests 11 and 12; with a seed that no test uses.

.venv/bin/python -m studies.nerve.fit [CLASS…]

The spread of RA's sensitivity is fitted to the same row, within the range that is published for thresholds, 2 to 3.
"""

import sys
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from sim.nerve.models import BUILT_IN, AfferentModel
from sim.nerve.ra import RA
from studies.nerve import published as pub
from studies.nerve.rows import rate_errors, vibration_rates
from studies.nerve.scenes import Scenes

Array = NDArray[np.float64]

FITTED_ON = {
    "SA1": (50.0, *pub.VIBRATION_50_HZ["SA1"]),
    "RA": (50.0, *pub.VIBRATION_50_HZ["RA"]),
    "PC": (300.0, *pub.VIBRATION_300_HZ),
}
SEED = 99
SPREADS = (2.0, 2.25, 2.5, 2.75, 3.0)
RA_AFFERENTS = 120


def error(scenes: Scenes, model: AfferentModel) -> tuple[float, list[int]]:
    """Return median |e| + |mean e| of a class on its row, and its rates."""
    frequency, amplitudes, known = FITTED_ON[model.name]
    mine = scenes.with_classes({model.name: model})
    rates = vibration_rates(mine, model.name, frequency, amplitudes, SEED)
    return sum(rate_errors(rates, known)), [round(float(rate)) for rate in rates]


def fitted(scenes: Scenes, model: AfferentModel, span: float = 30.0) -> AfferentModel:
    """Return a class with the best SED₀, searched on a grid that closes in."""
    best = model
    for _ in range(3):
        grid = best.reference_sed * np.geomspace(1 / span, span, 9)  # type: ignore[attr-defined]
        tried = [replace(best, reference_sed=float(f"{value:.3g}")) for value in grid]  # type: ignore[type-var]
        best = min(tried, key=lambda one: error(scenes, one)[0])
        span **= 0.3
    return best


def ra_error(scenes: Scenes, model: RA, spread: float) -> tuple[float, list[int]]:
    """Return the root mean square of e of RA on its row, and its rates."""
    frequency, amplitudes, known = FITTED_ON["RA"]
    mine = scenes.with_classes({"RA": model})
    rates = vibration_rates(mine, "RA", frequency, amplitudes, SEED, RA_AFFERENTS, spread)
    e = np.log2((rates + 5) / (np.array(known) + 5))
    return float(np.sqrt(np.mean(e**2))), [round(float(rate)) for rate in rates]


def fitted_ra(scenes: Scenes, model: RA) -> tuple[RA, float]:
    """Return RA with the best SED₀, and the best of `SPREADS`."""
    found = []
    for spread in SPREADS:

        def with_sed(logarithm: float) -> RA:
            return replace(model, reference_sed=float(f"{np.exp(logarithm):.3g}"))

        def loss(logarithm: float, spread: float = spread) -> float:
            return ra_error(scenes, with_sed(logarithm), spread)[0]

        near = np.log([model.reference_sed / 6, model.reference_sed * 6])
        best = minimize_scalar(loss, bounds=near, method="bounded", options={"maxiter": 14, "xatol": 0.02})
        one = with_sed(float(best.x))
        found.append((float(best.fun), one, spread))
        print("RA", spread, one.reference_sed, *ra_error(scenes, one, spread), flush=True)
    _, one, spread = min(found, key=lambda one: one[0])
    return one, spread


def main(names: list[str]) -> None:
    """Print SED₀ of each class and its error."""
    scenes = Scenes()
    for name in names or list(BUILT_IN):
        model = BUILT_IN[name]
        if isinstance(model, RA):
            print(name, *fitted_ra(scenes, model), flush=True)
        else:
            found = fitted(scenes, model)
            print(name, found, *error(scenes, found), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
