"""What fingers of the prior answer under a plate, beside what four people did.

    OMP_NUM_THREADS=1 .venv/bin/python -m studies.identification.under_a_plate     # half a minute; docs/validation

Both geometries of `studies/stiffening/fingers.py`. Stiffness multiplies force, so that each finger stands for all of
its stiffnesses; relaxation is left out. Forces are kept; `… press` presses anew.
"""

import json
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.identification.prior import Prior, tissue_of
from sim.identification.uncertainty_bands import ends
from sim.models.fingertip import Fingertip
from studies.stiffening.fingers import finger

Array = NDArray[np.float64]

KEPT = Path(__file__).parent / "kept" / "under_a_plate.json"
FINGERS = ("default", "human")
DEPTHS_MM = (1.0, 2.0)
FOUR_PEOPLE_N = ((0.11, 0.23), (0.50, 1.04))
"""Least and most of four people at these depths, and how force grows between them: Dandekar's data, as printed with
the HS2014 model."""

FOUR_PEOPLE_GROWTH = (4.6, 5.3)
_FINGERS = 60
_STIFFNESSES = 400


class PlateAnswers(NamedTuple):
    """Of fingers of the prior, under a plate."""

    force_n: Array  # (fingers, depths) at stiffness 1
    stiffness: Array  # (m,) equally likely

    def band_n(self, depth: int) -> tuple[float, float]:
        """That nine in ten lie in, at the depth of an index."""
        low, high = np.quantile(np.outer(self.force_n[:, depth], self.stiffness), ends())
        return float(low), float(high)

    @property
    def growth(self) -> tuple[float, float]:
        """The band of force at the second depth over that at the first."""
        low, high = np.quantile(self.force_n[:, 1] / self.force_n[:, 0], ends())
        return float(low), float(high)


def kept(name: str) -> PlateAnswers:
    """Of the fingers of a geometry that were pressed."""
    stiffness = np.exp(Prior().draws(_STIFFNESSES, np.random.default_rng(1))[:, Prior().index("ln_stiffness")])
    return PlateAnswers(np.array(json.loads(KEPT.read_text("utf-8"))[name]), stiffness)


def drawn() -> list[dict[str, float]]:
    """The fingers: parameters of the prior."""
    prior = Prior()
    rows = prior.draws(_FINGERS, np.random.default_rng(0)).tolist()
    return [dict(zip(prior.names, row, strict=True)) for row in rows]


def pressed(name: str, values: Mapping[str, float], *, exact: bool = False) -> Iterator[float]:
    """N at the depths, at stiffness 1."""
    tissue = tissue_of(values) | {"stiffness": 1.0}
    model, state = Fingertip.load(finger(name, **tissue), exact=exact), None
    for depth_mm in DEPTHS_MM:
        found = model.indent("flat", doi_mm=depth_mm, start=state)
        state = found.state
        yield found.force_n


def main() -> None:
    """Press where that is asked for; print the table."""
    if sys.argv[1:] == ["press"]:
        forces = {name: [[float(f"{f:.5g}") for f in pressed(name, one)] for one in drawn()] for name in FINGERS}
        KEPT.write_text(json.dumps(forces) + "\n", "utf-8")
    print("| finger | at 1 mm | at 2 mm | grows |", "|---|---|---|---|", sep="\n")
    for name in FINGERS:
        found = kept(name)
        cells = [f"{low:.2f} … {high:.2f} N" for low, high in (found.band_n(0), found.band_n(1))]
        print(f"| {name} | {' | '.join(cells)} | {found.growth[0]:.1f} … {found.growth[1]:.1f} times |")
    people = [f"{low:.2f} … {high:.2f} N" for low, high in FOUR_PEOPLE_N]
    print(f"| *four people* | {' | '.join(people)} | {FOUR_PEOPLE_GROWTH[0]} … {FOUR_PEOPLE_GROWTH[1]} times |")


if __name__ == "__main__":
    main()
