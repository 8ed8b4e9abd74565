"""Fit the gain of each class, SED₀, to its row of tests 11 and 12; with a seed that no test uses.

.venv/bin/python -m studies.nerve.fit [CLASS…]

RA's a₋ and the spread of its sensitivity, within the published 2 to 3, are fitted to tests 9, 11 and 16 together.
"""

import sys
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from sim.nerve.models import BUILT_IN, AfferentModel
from sim.nerve.ra import RA
from studies.nerve import published as pub
from studies.nerve.rows import entrained, on_and_off, rate_errors, vibration_rates
from studies.nerve.scenes import Scenes

Array = NDArray[np.float64]

FITTED_ON = {
    "SA1": (50.0, *pub.VIBRATION_50_HZ["SA1"]),
    "RA": (50.0, *pub.VIBRATION_50_HZ["RA"]),
    "PC": (300.0, *pub.VIBRATION_300_HZ),
}
SEED = 99
SPREADS = (2.0, 2.5, 3.0)
FALLING = (0.1, 0.2, 0.3, 0.4, 0.5, 0.75)
PLATEAU_OCTAVES, OFF_ON = float(np.log2(5)), (0.3, 1.2)
"""What tests 16 and 9 publish: one impulse a cycle from I1 to five times as much; impulses off over on."""
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


def ra_misfit(scenes: Scenes, model: RA, spread: float) -> tuple[float, float, float]:
    """Return how far RA is from tests 9, 11 and 16 together, its plateau in octaves, and impulses off over on."""
    mine = scenes.with_classes({"RA": model})
    _, octaves, _, _ = entrained(mine, SEED, spread)
    _, ratio, _ = on_and_off(mine, "RA", SEED, spread)
    beyond = max(OFF_ON[0] - ratio, 0.0) / OFF_ON[0] + max(ratio - OFF_ON[1], 0.0) / OFF_ON[1]
    return ra_error(scenes, model, spread)[0] + abs(octaves / PLATEAU_OCTAVES - 1) + beyond, octaves, ratio


def fitted_ra(scenes: Scenes, model: RA) -> tuple[RA, float]:
    """Return RA with the best a₋ and its spread; SED₀ is the best of test 11 for each."""
    found = []
    for falling in FALLING:
        for spread in SPREADS:

            def with_sed(logarithm: float, falling: float = falling) -> RA:
                return replace(model, falling=falling, reference_sed=float(f"{np.exp(logarithm):.3g}"))

            def loss(logarithm: float, spread: float = spread, make: Callable[[float], RA] = with_sed) -> float:
                return ra_error(scenes, make(logarithm), spread)[0]

            near = np.log([model.reference_sed / 4, model.reference_sed * 4])
            best = minimize_scalar(loss, bounds=near, method="bounded", options={"maxiter": 10, "xatol": 0.03})
            one = with_sed(float(best.x))
            misfit, octaves, ratio = ra_misfit(scenes, one, spread)
            found.append((misfit, one, spread))
            error, rates = ra_error(scenes, one, spread)
            print(
                f"RA a- {falling} spread {spread} SED0 {one.reference_sed} misfit {misfit:.3f} e {error:.3f} "
                f"plateau {octaves:.2f} off/on {ratio:.2f}",
                rates,
                flush=True,
            )
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
