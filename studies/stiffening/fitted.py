"""The numbers of `sim/models/stiffening.py`, fitted to the kept references, and how near they come.

    .venv/bin/python -m studies.stiffening.fitted          # seconds; docs/validation/stiffening.md

Force is fitted to this study's references and to the neo-Hookean ones of `studies/finite_strain`, energy to this
study's, both to 2 mm. Paths that are held back, and those pressed afterwards, are not fitted: they are judged by
numbers that never saw them.
"""

from collections.abc import Callable, Iterator, Sequence
from operator import attrgetter
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from sim.models.stiffening import (
    ENERGY,
    FORCE,
    DimensionlessPress,
    Energy,
    ForceFactor,
    ReceptorPress,
    log_energy,
    log_force,
)
from studies.finite_strain.tables import kept_ratios
from studies.stiffening.fingers import finger
from studies.stiffening.twins import Pair, kept_pairs, pressed

Array = NDArray[np.float64]
Path = tuple[str, str, float]
Numbers = TypeVar("Numbers", ForceFactor, Energy)

DEEPEST_MM = 2.0
HELD_BACK_SHAPE, HELD_BACK_FINGER = "cylinder:4", "firm throughout"
PARTS = FITTED, HELD_BACK, AFTERWARDS = "fitted", "held back", "afterwards"
_HEARD = 0.3  # of the highest SED: receptors below are not fitted
_HIGHEST_COUNTS = 10.0  # what is asked for is the highest
_BEYOND, _BEYOND_COUNTS = 0.8, 0.5  # stiffening that the prior does not hold


class StiffeningSample(NamedTuple):
    """A logarithm of finite strain over linear, where it was measured, and how much it counts."""

    finger: str
    shape: str
    stiffening: float
    doi_mm: float
    press: DimensionlessPress
    log: float
    felt: tuple[float, ...] = (0.0, 1.0, 1.0)  # a `ReceptorPress` of one receptor; of no meaning where it is force
    counts: float = 1.0
    highest: bool = True
    afterwards: bool = False

    @property
    def path(self) -> Path:
        """Of one press down."""
        return self.finger, self.shape, self.stiffening

    @property
    def part(self) -> str:
        """What it is there for: all but the first judge only."""
        if self.afterwards:
            return AFTERWARDS
        return HELD_BACK if self.shape == HELD_BACK_SHAPE or self.finger == HELD_BACK_FINGER else FITTED

    @property
    def held_back(self) -> bool:
        """Whether it judges only."""
        return self.part != FITTED


def forces(found: Sequence[Pair]) -> Iterator[StiffeningSample]:
    """Of this study and of the one at finite strain without stiffening."""
    for pair in found:
        yield StiffeningSample(
            *_where(pair), pair.press, pair.log_force, counts=_counts(pair), afterwards=pair.afterwards
        )
    for ratio in kept_ratios():
        if ratio.mesh == "finger 0.35" and ratio.poisson == finger("default").tissue.poisson:
            press = pressed("default", ratio.shape, ratio.doi_mm)
            yield StiffeningSample("default", ratio.shape, 0.0, ratio.doi_mm, press, -float(np.log(ratio.force)))


def energies(found: Sequence[Pair]) -> Iterator[StiffeningSample]:
    """SED at the receptors that are not far below the highest, by the linear twin or at finite strain."""
    for pair in found:
        sed = np.array(pair.reference["sed"])
        for k in _heard(pair):
            felt = tuple(float(values[k]) for values in pair.felt)
            highest = k == int(np.argmax(sed))
            counts = _counts(pair) * (_HIGHEST_COUNTS if highest else 1.0)
            where = (*_where(pair), pair.press, float(pair.log_sed[k]), felt)
            yield StiffeningSample(*where, counts, highest, pair.afterwards)


def strains(found: Sequence[Pair]) -> Iterator[StiffeningSample]:
    """The most compressive strain at the same receptors, to which nothing is fitted."""
    for pair in found:
        log = np.log(np.array(pair.reference["ep1"]) / np.array(pair.twin["ep1"]))
        for k in _heard(pair):
            felt = tuple(float(values[k]) for values in pair.felt)
            yield StiffeningSample(*_where(pair), pair.press, float(log[k]), felt, afterwards=pair.afterwards)


def _heard(pair: Pair) -> list[int]:
    sed, linear = np.array(pair.reference["sed"]), pair.linear_sed
    return [int(k) for k in np.flatnonzero((linear > _HEARD * linear.max()) | (sed > _HEARD * sed.max()))]


def strain_errors(seen: Sequence[StiffeningSample]) -> Array:
    """(n,) quick over finite strain, logarithms: strains have the root of energy without its law."""
    log = np.array([one.log for one in seen])
    return 0.5 * errors([one._replace(stiffening=0.0, log=0.0) for one in seen], ENERGY) - log


def _where(pair: Pair) -> tuple[str, str, float, float]:
    row = pair.reference
    return row["finger"], row["shape"], row["stiffening"], row["doi_mm"]


def _counts(pair: Pair) -> float:
    return 1.0 if pair.reference["stiffening"] <= _BEYOND else _BEYOND_COUNTS


def errors(seen: Sequence[StiffeningSample], numbers: ForceFactor | Energy) -> Array:
    """(n,) quick over finite strain, logarithms."""
    return _errors(seen, type(numbers))(np.array(numbers))


def fitted(seen: Sequence[StiffeningSample], start: Numbers) -> Numbers:
    """Numbers of least squares for what is not held back and within depth, from some to begin with."""
    fits = [one for one in seen if one.doi_mm <= DEEPEST_MM and not one.held_back]
    counts, left = np.array([one.counts for one in fits]), _errors(fits, type(start))
    found = least_squares(lambda values: counts * left(values), np.array(start), x_scale="jac", xtol=1e-12)
    return type(start)(*found.x.tolist())


def _errors(seen: Sequence[StiffeningSample], kind: type[ForceFactor] | type[Energy]) -> Callable[[Array], Array]:
    press = DimensionlessPress(*np.array([one.press for one in seen]).T)
    felt = ReceptorPress(*np.array([one.felt for one in seen]).T)
    stiffening, log = np.array([(one.stiffening, one.log) for one in seen]).T
    if kind is ForceFactor:
        return lambda values: log_force(ForceFactor(*values), stiffening, press) - log
    return lambda values: log_energy(Energy(*values), stiffening, press, felt) - log


def left_out(seen: Sequence[StiffeningSample], start: Numbers, what: Callable[[StiffeningSample], str]) -> Array:
    """(n,) errors by numbers that were fitted without all that is alike: a finger or a shape."""
    error = np.full(len(seen), np.nan)
    for name in sorted({what(one) for one in seen}):
        there = np.array([what(one) == name for one in seen])
        rest = [one for one, left in zip(seen, there, strict=True) if not left]
        error[there] = errors(seen, fitted(rest, start))[there]
    return error


def table(force: Sequence[StiffeningSample], energy: Sequence[StiffeningSample]) -> Iterator[str]:
    """Largest errors of each path to 1 and 2 mm, and beyond: of force, and of SED at the highest receptor."""
    yield "| finger | shape | a | to | force to 1 mm | to 2 mm | deeper | SED to 1 mm | to 2 mm | deeper |"
    yield "|---|---|---|---|---|---|---|---|---|---|"
    highest = [one for one in energy if one.highest]
    judged = [(force, errors(force, FORCE)), (highest, errors(highest, ENERGY))]
    here: dict[tuple[str, Path], list[float]] = {}
    for one in force:
        here.setdefault((one.part, one.path), []).append(one.doi_mm)
    for (part, path), depths_mm in sorted(here.items(), key=lambda item: PARTS.index(item[0][0])):
        name = path[0] if part == FITTED else f"*{part}:* {path[0]}"
        cells = [cell for seen, error in judged for cell in _cells(seen, error, (part, path))]
        yield f"| {name} | {path[1]} | {path[2]:g} | {max(depths_mm):.3g} | {' | '.join(cells)} |"


def _cells(seen: Sequence[StiffeningSample], error: Array, which: tuple[str, Path]) -> Iterator[str]:
    there = np.array([(one.part, one.path) == which for one in seen])
    doi = np.array([one.doi_mm for one in seen])
    for low, high in ((0, 1), (0, DEEPEST_MM), (DEEPEST_MM, 9)):
        within = there & (doi > low) & (doi <= high)
        yield f"{100 * np.expm1(np.abs(error[within]).max()):.1f} %" if within.any() else ""


def spread(seen: Sequence[StiffeningSample], error: Array) -> str:
    """Rms and largest error to 2 mm, of tissue that the prior holds, of each part."""
    within = np.array([one.doi_mm <= DEEPEST_MM and one.stiffening <= _BEYOND for one in seen])
    parts = {part: error[within & [one.part == part for one in seen]] for part in PARTS}
    return "; ".join(
        f"{part}: {100 * np.sqrt(np.mean(e**2)):.1f} % rms, {100 * np.expm1(np.abs(e).max()):.1f} % at most"
        for part, e in parts.items()
        if len(e)
    )


def main() -> None:
    """Print numbers and tables."""
    found = kept_pairs()
    force, energy = list(forces(found)), list(energies(found))
    for numbers in (fitted(force, FORCE), fitted(energy, ENERGY)):
        print(type(numbers).__name__, tuple(float(f"{value:.4g}") for value in numbers))
    print("\n".join(table(force, energy)))
    highest = [one for one in energy if one.highest]
    print("force,", spread(force, errors(force, FORCE)))
    print("highest SED,", spread(highest, errors(highest, ENERGY)))
    for what in ("finger", "shape"):
        error = left_out(energy, ENERGY, attrgetter(what))
        print(f"highest SED, its {what} left out,", spread(highest, error[[one.highest for one in energy]]))
    print("receptors above 0.3 of the highest,", spread(energy, errors(energy, ENERGY)))
    strain = list(strains(found))
    print("most compressive strain there,", spread(strain, strain_errors(strain)))
    print("of the linear twin,", spread(strain, np.array([-one.log for one in strain])))


if __name__ == "__main__":
    main()
