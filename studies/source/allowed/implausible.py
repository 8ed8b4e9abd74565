"""How far a finger is from what the figures say, in standard deviations of all that may be wrong with that.

Implausibility (Craig, Goldstein, Seheult & Smith 1997; Vernon, Goldstein & Bower 2010): distance of a fact from its
target over the root of the variances of emulator, reading, model and mesh. Beyond 3 a finger is ruled out, whatever
the distribution, by Pukelsheim's rule (1994): 95 % of any unimodal one lies within.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from studies.source.allowed.emulator import Emulator, held_back, learn

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

CUT_OFF = 3.0
FEWEST = 2
"""A fact that fewer fingers show than this times the coefficients of a linear trend is not emulated."""


@dataclass(frozen=True)
class FactTarget:
    """Where a fact lies on the source's finger, and one standard deviation of what is read and of the model."""

    key: str
    low: float
    high: float
    reading: float
    model: float

    def off(self, value: Array) -> Array:
        """Distance from the target, 0 within it."""
        return np.maximum(np.maximum(self.low - value, value - self.high), 0.0)


@dataclass(frozen=True)
class MeshDeviation:
    """What the default mesh adds to a fact of the design's mesh, and one standard deviation of that."""

    shift: float = 0.0
    deviation: float = 0.0


def mesh_error(coarse: Array, full: Array) -> MeshDeviation:
    """Of one fact on the same fingers (n,); the deviation is that of another finger from the mean of these."""
    both = np.isfinite(coarse) & np.isfinite(full)
    d = (full - coarse)[both]
    if len(d) < 2:
        return MeshDeviation(float(d.sum()), np.inf)
    return MeshDeviation(float(d.mean()), float(d.std(ddof=1) * np.sqrt(1 + 1 / len(d))))


@dataclass(frozen=True)
class Judge:
    """One fact: its target, what the mesh does to it, its emulator, and the factor on what that expects of itself."""

    target: FactTarget
    mesh: MeshDeviation
    emulator: Emulator
    widened: float
    relative_error: float

    def expected(self, x: Array) -> tuple[Array, Array]:
        """(m,) means on the default mesh and standard deviations of emulator and mesh together."""
        mean, deviation = self.emulator.predict(x)
        return mean + self.mesh.shift, np.hypot(self.widened * deviation, self.mesh.deviation)

    def implausibility(self, x: Array, inflation: float = 1.0) -> Array:
        """(m,) of places (m, d); `inflation` multiplies the standard deviations of reading and model."""
        mean, deviation = self.expected(x)
        return self.target.off(mean) / np.hypot(
            deviation, inflation * np.hypot(self.target.reading, self.target.model)
        )


def judges(x: Array, facts: Array, targets: Sequence[FactTarget], meshes: Sequence[MeshDeviation]) -> list[Judge]:
    """One for each fact that enough fingers show: (n, d) places, (n, facts) values, nan where there is none."""
    found = []
    for y, target, mesh in zip(facts.T, targets, meshes, strict=True):
        shown = np.isfinite(y)
        if shown.sum() >= FEWEST * (1 + x.shape[1]) and np.isfinite(mesh.deviation):
            emulator = learn(x[shown], y[shown])
            error = held_back(x[shown], y[shown], emulator)
            found.append(Judge(target, mesh, emulator, max(1.0, error.expected), error.relative))
    return found


def measured(targets: Sequence[FactTarget], facts: Array) -> Array:
    """(n, facts) implausibilities of what was measured on the default mesh: reading and model alone."""
    off = np.stack([t.off(y) for t, y in zip(targets, facts.T, strict=True)], axis=1)
    return np.asarray(off / np.array([np.hypot(t.reading, t.model) for t in targets]))


def worst(found: Sequence[Judge], x: Array, inflation: float = 1.0) -> Array:
    """(m,) the largest implausibility of any fact."""
    return np.max([judge.implausibility(x, inflation) for judge in found], axis=0)


def allowed(found: Sequence[Judge], x: Array, inflation: float = 1.0) -> Flags:
    """(m,) which places no fact rules out."""
    left = np.arange(len(x))
    for judge in found:
        left = left[judge.implausibility(x[left], inflation) <= CUT_OFF]
    flags = np.zeros(len(x), dtype=bool)
    flags[left] = True
    return flags


def inflation_needed(found: Sequence[Judge], x: Array, share: float) -> float:
    """The least factor, in tenths, at which at least that share of the places is left; 1 where they are anyway."""
    factor = 1.0
    while np.mean(allowed(found, x, factor)) < share:
        factor = round(factor + 0.1, 1)
    return factor
