"""The numbers of `sim/models/stiffening/at_finite_strain.py`, fitted to the kept references, and how near they come.

    .venv/bin/python -m studies.stiffening.fitted          # seconds; the table of docs/meet.md

Force is fitted to this study's references and to the neo-Hookean ones of `studies/finite_strain`, energy to this
study's, both to 2 mm. Paths that are held back are not fitted: they are judged by numbers that never saw them.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from sim.models.stiffening.at_finite_strain import FORCE, SECANT, Force, Press, Secant, log_force, log_secant
from studies.finite_strain.tables import kept_ratios
from studies.stiffening.fingers import finger
from studies.stiffening.twins import Pair, kept_pairs, pressed

Array = NDArray[np.float64]
Numbers = TypeVar("Numbers", Force, Secant)

DEEPEST_MM = 2.0
HELD_BACK_SHAPE, HELD_BACK_FINGER = "cylinder:4", "firm throughout"
_HEARD = 0.3  # of the highest SED: receptors below are not fitted
_HIGHEST_COUNTS = 10.0  # what is asked for is the highest
_BEYOND, _BEYOND_COUNTS = 0.8, 0.5  # stiffening that the prior does not hold


class Seen(NamedTuple):
    """A logarithm of finite strain over linear, where it was measured, and how much it counts."""

    finger: str
    shape: str
    stiffening: float
    doi_mm: float
    press: Press
    log: float
    share: float = 1.0
    counts: float = 1.0
    highest: bool = True

    @property
    def path(self) -> tuple[str, str, float]:
        """Of one press down."""
        return self.finger, self.shape, self.stiffening

    @property
    def held_back(self) -> bool:
        """Whether it judges only."""
        return self.shape == HELD_BACK_SHAPE or self.finger == HELD_BACK_FINGER


def forces(found: Sequence[Pair]) -> Iterator[Seen]:
    """Of this study and of the one at finite strain without stiffening."""
    for pair in found:
        yield Seen(*_where(pair), pair.press, pair.log_force, counts=_counts(pair))
    for ratio in kept_ratios():
        if ratio.mesh == "finger 0.35" and ratio.poisson == finger("default").tissue.poisson:
            press = pressed("default", ratio.shape, ratio.doi_mm)
            yield Seen("default", ratio.shape, 0.0, ratio.doi_mm, press, -float(np.log(ratio.force)))


def energies(found: Sequence[Pair]) -> Iterator[Seen]:
    """SED at the receptors that are not far below the highest."""
    for pair in found:
        sed = pair.reference["sed"]
        for k in np.flatnonzero(pair.linear_sed > _HEARD * pair.linear_sed.max()).tolist():
            highest = k == int(np.argmax(sed))
            counts = _counts(pair) * (_HIGHEST_COUNTS if highest else 1.0)
            yield Seen(*_where(pair), pair.press, float(pair.log_sed[k]), float(pair.share[k]), counts, highest)


def _where(pair: Pair) -> tuple[str, str, float, float]:
    row = pair.reference
    return row["finger"], row["shape"], row["stiffening"], row["doi_mm"]


def _counts(pair: Pair) -> float:
    return 1.0 if pair.reference["stiffening"] <= _BEYOND else _BEYOND_COUNTS


def errors(seen: Sequence[Seen], numbers: Force | Secant) -> Array:
    """(n,) quick over finite strain, logarithms."""
    return _errors(seen, type(numbers))(np.array(numbers))


def fitted(seen: Sequence[Seen], start: Numbers) -> Numbers:
    """Numbers of least squares for what is not held back and within depth, from some to begin with."""
    fits = [one for one in seen if one.doi_mm <= DEEPEST_MM and not one.held_back]
    counts, left = np.array([one.counts for one in fits]), _errors(fits, type(start))
    found = least_squares(lambda values: counts * left(values), np.array(start), x_scale="jac", xtol=1e-12)
    return type(start)(*found.x.tolist())


def _errors(seen: Sequence[Seen], kind: type[Force] | type[Secant]) -> Callable[[Array], Array]:
    press = Press(*np.array([one.press for one in seen]).T)
    stiffening, share, log = np.array([(one.stiffening, one.share, one.log) for one in seen]).T
    if kind is Force:
        return lambda values: log_force(Force(*values), stiffening, press) - log
    return lambda values: log_secant(Secant(*values), stiffening, press, share) - log


def table(force: Sequence[Seen], energy: Sequence[Seen]) -> Iterator[str]:
    """Largest errors of each path to 1 and 2 mm, and beyond: of force, and of SED at the highest receptor."""
    yield "| finger | shape | a | to | force to 1 mm | to 2 mm | deeper | SED to 1 mm | to 2 mm | deeper |"
    yield "|---|---|---|---|---|---|---|---|---|---|"
    highest = [one for one in energy if one.highest]
    judged = [(force, errors(force, FORCE)), (highest, errors(highest, SECANT))]
    for path in sorted(dict.fromkeys(one.path for one in force), key=_held_last):
        here = [one for one in force if one.path == path]
        name = f"*held back:* {path[0]}" if here[0].held_back else path[0]
        cells = [cell for seen, error in judged for cell in _cells(seen, error, path)]
        yield f"| {name} | {path[1]} | {path[2]:g} | {max(o.doi_mm for o in here):.3g} | {' | '.join(cells)} |"


def _held_last(path: tuple[str, str, float]) -> bool:
    return path[1] == HELD_BACK_SHAPE or path[0] == HELD_BACK_FINGER


def _cells(seen: Sequence[Seen], error: Array, path: tuple[str, str, float]) -> Iterator[str]:
    there = np.array([one.path == path for one in seen])
    doi = np.array([one.doi_mm for one in seen])
    for low, high in ((0, 1), (0, DEEPEST_MM), (DEEPEST_MM, 9)):
        within = there & (doi > low) & (doi <= high)
        yield f"{100 * np.expm1(np.abs(error[within]).max()):.1f} %" if within.any() else ""


def spread(seen: Sequence[Seen], error: Array) -> str:
    """Rms and largest error to 2 mm, of tissue that the prior holds: of what was fitted and of what was held back."""
    within = np.array([one.doi_mm <= DEEPEST_MM and one.stiffening <= _BEYOND for one in seen])
    held = np.array([one.held_back for one in seen])
    parts = {"fitted": error[within & ~held], "held back": error[within & held]}
    return "; ".join(
        f"{name}: {100 * np.sqrt(np.mean(e**2)):.1f} % rms, {100 * np.expm1(np.abs(e).max()):.1f} % at most"
        for name, e in parts.items()
    )


def main() -> None:
    """Print numbers and tables."""
    found = kept_pairs()
    force, energy = list(forces(found)), list(energies(found))
    for numbers in (fitted(force, FORCE), fitted(energy, SECANT)):
        print(type(numbers).__name__, tuple(float(f"{value:.4g}") for value in numbers))
    print("\n".join(table(force, energy)))
    highest = [one for one in energy if one.highest]
    print("force,", spread(force, errors(force, FORCE)))
    print("highest SED,", spread(highest, errors(highest, SECANT)))
    print("receptors above 0.3 of the highest,", spread(energy, errors(energy, SECANT)))


if __name__ == "__main__":
    main()
