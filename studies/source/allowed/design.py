"""Fingers of a wave: space-filling over all ranges first, over what is left of them later; asked one by one."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist
from scipy.stats import qmc

from studies.source.allowed import kept

Array = NDArray[np.float64]
Ask = Callable[[Mapping[str, float]], dict[str, float]]
Say = Callable[[str], object]

SEED = 1998


@dataclass(frozen=True)
class Asked:
    """How a finger is asked, and its place (d,) in units of the ranges has values and back."""

    values_at: Callable[[Array], dict[str, float]]
    place_of: Callable[[Mapping[str, float]], Array]
    ask: Ask
    parameters: Sequence[str]
    facts: Sequence[str]

    def places_of(self, table: kept.FingerSample) -> Array:
        """(n, d) of the fingers of a table."""
        return np.array([self.place_of(dict(zip(self.parameters, row, strict=True))) for row in table.values])


def filling(n: int, dimensions: int, seed: int = SEED) -> Array:
    """(n, dimensions) places of a scrambled Sobol sequence; n a power of two."""
    return qmc.Sobol(dimensions, seed=seed).random(n)


def spread_among(candidates: Array, n: int, taken: Array) -> Array:
    """(≤ n, d) of the candidates (m, d), one after another the farthest from those taken (k, d) and chosen."""
    nearest = cdist(candidates, taken).min(axis=1) if len(taken) else np.full(len(candidates), np.inf)
    chosen: list[int] = []
    for _ in range(min(n, len(candidates))):
        k = int(np.argmax(nearest))
        chosen.append(k)
        nearest = np.minimum(nearest, np.linalg.norm(candidates - candidates[k], axis=1))
    return candidates[chosen]


def run(asked: Asked, places: Array, path: Path, say: Say = print, **told: int) -> kept.FingerSample:
    """Every finger that the table has not yet; each is on disk before the next is begun, what is told beside it."""
    done = set(kept.read(path, asked.parameters, asked.facts).numbers.tolist())
    if len(done) < len(places):
        kept.write_provenance(path, fingers=len(places), seed=SEED, **told)
    for number, place in enumerate(places):
        if number in done:
            continue
        values = asked.values_at(place)
        kept.append(path, number, values, _answers(asked, values))
        say(f"{path.stem}: finger {number + 1} of {len(places)}")
    return kept.read(path, asked.parameters, asked.facts)


def _answers(asked: Asked, values: Mapping[str, float]) -> dict[str, float]:
    """By fact; none where there is no such finger."""
    try:
        return asked.ask(values)
    except ValueError:  # what the model refuses: layers that do not fit, a skin that crosses the bone's axis
        return dict.fromkeys(asked.facts, np.nan)
