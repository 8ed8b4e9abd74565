"""Fit the gain of each class, SED₀, to its row of tests 11 and 12; with a seed that no test uses.

.venv/bin/python -m studies.nerve.fit [CLASS…]
"""

import sys
from dataclasses import replace

import numpy as np

from sim.nerve.models import BUILT_IN, AfferentModel
from studies.nerve import published as pub
from studies.nerve.rows import rate_errors, vibration_rates
from studies.nerve.scenes import Scenes

FITTED_ON = {
    "SA1": (50.0, *pub.VIBRATION_50_HZ["SA1"]),
    "RA": (50.0, *pub.VIBRATION_50_HZ["RA"]),
    "PC": (300.0, *pub.VIBRATION_300_HZ),
}
SEED = 99


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


def main(names: list[str]) -> None:
    """Print SED₀ of each class and its error."""
    scenes = Scenes()
    for name in names or list(BUILT_IN):
        found = fitted(scenes, BUILT_IN[name])
        print(name, found, *error(scenes, found), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
