"""The numbers of `sim/models/stiffening/at_finite_strain.py`, fitted to the kept references, and how near they come.

    .venv/bin/python -m studies.stiffening.fitted          # a minute; the tables of docs/meet.md

Force is fitted to this study's references and to the neo-Hookean ones of `studies/finite_strain`, energy to this
study's. What was held back is judged by numbers that were fitted without it.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from sim.contact.patch import X, Z
from sim.contact.shapes import parse_shape
from sim.contact.touch import first_touch
from sim.finger.surface import FingertipSurface
from sim.models.stiffening.at_finite_strain import FORCE, SECANT, Numbers, Press, log_factor
from sim.models.stiffening.stiffened import Under
from studies.finite_strain.tables import kept_ratios
from studies.stiffening.fingers import finger
from studies.stiffening.references import read
from studies.stiffening.twins import Pair, pairs

Array = NDArray[np.float64]

KEPT = Path(__file__).parent / "kept" / "references.jsonl"
DEEPEST_MM = 2.0
_HEARD = 0.3  # of the highest SED: receptors below are not fitted
_HIGHEST_COUNTS = 3.0
_BEYOND, _BEYOND_COUNTS = 0.8, 0.5  # stiffening that the prior does not hold
_OF_FORCE = ("arch", "arch_bend", "arch_width", "squeeze", "squeeze_depth", "squeeze_width", "law_strain")
FREE = {
    "force": (*_OF_FORCE, "law_depth", "law_width"),
    "energy": (*_OF_FORCE, "law", "depth"),
}
_POSITIVE = ("arch_bend", "law_strain")
START = {"force": FORCE, "energy": SECANT}


class Seen(NamedTuple):
    """A logarithm of finite strain over linear, where it was measured, and how much it counts."""

    finger: str
    shape: str
    stiffening: float
    doi_mm: float
    press: Press
    squeezed: float
    log: float
    counts: float = 1.0
    highest: bool = True

    @property
    def path(self) -> tuple[str, str, float]:
        """Of one press down."""
        return self.finger, self.shape, self.stiffening


def forces(found: Sequence[Pair]) -> Iterator[Seen]:
    """Of this study and of the one at finite strain without stiffening."""
    for pair in found:
        row = pair.reference
        counts = 1.0 if row["stiffening"] <= _BEYOND else _BEYOND_COUNTS
        where = row["finger"], row["shape"], row["stiffening"], row["doi_mm"]
        yield Seen(*where, pair.press, pair.press.depth, pair.log_force, counts)
    for ratio in kept_ratios():
        if ratio.mesh == "finger 0.35" and ratio.poisson == finger("default").tissue.poisson:
            press = pressed("default", ratio.shape, ratio.doi_mm)
            yield Seen("default", ratio.shape, 0.0, ratio.doi_mm, press, press.depth, -float(np.log(ratio.force)))


def energies(found: Sequence[Pair]) -> Iterator[Seen]:
    """SED at the receptors that are not far below the highest."""
    for pair in found:
        row, sed = pair.reference, np.array(pair.reference["sed"])
        where = row["finger"], row["shape"], row["stiffening"], row["doi_mm"]
        for k in np.flatnonzero(pair.linear_sed > _HEARD * pair.linear_sed.max()).tolist():
            highest = k == int(np.argmax(sed))
            counts = _HIGHEST_COUNTS if highest else 1.0
            yield Seen(*where, pair.press, float(pair.local[k]), float(pair.log_sed[k]), counts, highest)


def pressed(name: str, shape: str, doi_mm: float) -> Press:
    """A press of one of the study's fingers, as the simulator sees it."""
    config, indentor = finger(name, stiffening=1.0), parse_shape(shape)
    surface = FingertipSurface.fit(config.geometry)
    place = tuple({X: 0.0, Z: config.receptor_plane_mm}[axis] for axis in indentor.axes)
    under = Under(config, surface, indentor, place, first_touch(indentor, place, surface))
    return under.at(doi_mm, np.zeros((0, 3))).press


def fitted(seen: Sequence[Seen], what: str) -> Numbers:
    """Numbers of least squares, from those that stand in the code."""
    start, free = START[what], FREE[what]
    counts = np.array([one.counts for one in seen])

    def left(values: Array) -> Array:
        return counts * errors(seen, _with(start, free, values))

    least = [1e-3 if name in _POSITIVE else -np.inf for name in free]
    found = least_squares(left, [getattr(start, name) for name in free], bounds=(least, np.inf), max_nfev=400)
    return _with(start, free, found.x)


def _with(start: Numbers, free: Sequence[str], values: Array) -> Numbers:
    return start._replace(**dict(zip(free, values.tolist(), strict=True)))


def errors(seen: Sequence[Seen], numbers: Numbers) -> Array:
    """(n,) quick over finite strain, logarithms."""
    return np.array([float(log_factor(numbers, s.stiffening, s.press, np.array(s.squeezed))) - s.log for s in seen])


def held_back(seen: Sequence[Seen], what: str) -> Array:
    """(n,) errors of each, by numbers that were fitted without its path."""
    found = np.empty(len(seen))
    for path in dict.fromkeys(one.path for one in seen):
        out = np.array([one.path == path for one in seen])
        numbers = fitted([one for one in seen if one.path != path], what)
        found[out] = errors([one for one in seen if one.path == path], numbers)
    return found


def table(seen: Sequence[Seen], error: Array) -> Iterator[str]:
    """Largest errors of each path to 1 and 2 mm, and beyond."""
    yield "| finger | shape | stiffening | to 1 mm | to 2 mm | deeper |"
    yield "|---|---|---|---|---|---|"
    for path in dict.fromkeys(one.path for one in seen):
        there = np.array([one.path == path for one in seen])
        doi = np.array([one.doi_mm for one in seen])
        ranges = [there & (doi > low) & (doi <= high) for low, high in ((0, 1), (0, DEEPEST_MM), (DEEPEST_MM, 9))]
        cells = [f"{100 * np.expm1(np.abs(error[r]).max()):.1f} %" if r.any() else "–" for r in ranges]
        yield f"| {path[0]} | {path[1]} | {path[2]:g} | {' | '.join(cells)} |"


def main() -> None:
    """Print numbers and tables."""
    found = list(pairs(read(KEPT)))
    judged = {"force": list(forces(found)), "energy": list(energies(found))}
    for what, seen in judged.items():
        inside = [one for one in seen if one.doi_mm <= DEEPEST_MM]
        print(what, tuple(round(value, 4) for value in fitted(inside, what)))
        highest = [one for one in seen if one.highest]
        print("\n".join(table(highest, errors(highest, START[what]))))
        error = held_back(inside, what)[[one.highest for one in inside]]
        print(f"each path held back: rms {error.std():.3f}, largest {np.abs(error).max():.3f}")


if __name__ == "__main__":
    main()
