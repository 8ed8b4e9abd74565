"""References beside the quick answer's inputs: linear twins on the same meshes, pressed by the simulator itself.

    .venv/bin/python -m studies.stiffening.twins studies/stiffening/kept

Presses what is missing there, seconds a finger. Kept, so that a fit and its tables take no finite elements.
"""

import json
import sys
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.contact.first_contact import first_touch
from sim.contact.patch import X, Z
from sim.contact.shapes import parse_shape
from sim.errors import ModelRangeError
from sim.finger.surface import FingertipSurface
from sim.models.catalogue import load
from sim.models.fingertip import Fingertip
from sim.models.stiffening import DimensionlessPress, ReceptorPress, Under
from studies.stiffening.fingers import finger
from studies.stiffening.references import read

Array = NDArray[np.float64]
Row = Mapping[str, Any]

REFERENCES, AFTERWARDS, TWINS = "references.jsonl", "afterwards.jsonl", "twins.jsonl"
KEPT = Path(__file__).parent / "kept"
_ANY = 1.0  # stiffening of the finger that is asked how it is pressed; its linear twin is the same for all


class Pair(NamedTuple):
    """A press at finite strain, its linear twin, and the numbers by which the twin is corrected.

    afterwards: whether it was pressed when all numbers had been fitted.
    """

    reference: Row
    twin: Row
    press: DimensionlessPress
    afterwards: bool = False

    @property
    def felt(self) -> ReceptorPress:
        """By the receptors, (n,)."""
        return ReceptorPress(*(np.array(self.twin[name]) for name in ReceptorPress._fields))

    @property
    def log_force(self) -> float:
        """Of finite strain over the twin's."""
        return float(np.log(self.reference["force"] / self.twin["force"]))

    @property
    def log_sed(self) -> Array:
        """(n,) the same of SED at the receptors."""
        return np.asarray(np.log(np.array(self.reference["sed"]) / self.linear_sed))

    @property
    def linear_sed(self) -> Array:
        """(n,) of the twin, pseudo-units."""
        return np.array(self.twin["sed"])


def kept_pairs(folder: Path = KEPT) -> list[Pair]:
    """All references of a folder, those in the repository, that have a twin."""
    there = {_press_of(row): row for row in read(folder / TWINS)}
    return [
        Pair(row, there[_press_of(row)], pressed(*_press_of(row)), afterwards=name == AFTERWARDS)
        for name in (REFERENCES, AFTERWARDS)
        for row in read(folder / name)
        if _press_of(row) in there
    ]


def pressed(name: str, shape: str, doi_mm: float) -> DimensionlessPress:
    """A press of one of the study's fingers, as the simulator sees it."""
    return _under(name, shape).at(doi_mm, np.zeros((0, 3))).press


def twin(name: str, shape: str, doi_mm: float) -> dict[str, Any] | None:
    """A row; None where the press leaves its patch. Force for E = 1 MPa, SED in pseudo-units."""
    try:
        found = _finger(name).indent(shape, doi_mm=doi_mm)
    except ModelRangeError:
        return None
    model = found.model
    linear = model.measures(found.receptor_strain)
    felt = found.strained.at_receptors(linear["sed"], model.receptor_e, model.poisson)
    return {
        **{"finger": name, "shape": shape, "doi_mm": doi_mm, "force": float(f"{found.state.normal_force:.7g}")},
        **{measure: _short(linear[measure]) for measure in ("sed", "ep1")},
        **{field: _short(values) for field, values in felt._asdict().items()},
    }


def main(folder: str) -> None:
    """Append what is missing."""
    place = Path(folder)
    done = {_press_of(row) for row in read(place / TWINS)}
    rows = [row for name in (REFERENCES, AFTERWARDS) for row in read(place / name)]
    for press in dict.fromkeys(map(_press_of, rows)):
        row = None if press in done else twin(*press)
        if row is not None:
            with (place / TWINS).open("a", encoding="utf-8") as out:
                out.write(json.dumps(row) + "\n")


def _press_of(row: Row) -> tuple[str, str, float]:
    return row["finger"], row["shape"], row["doi_mm"]


def _short(values: Array) -> list[float]:
    return [float(f"{value:.6g}") for value in values]


@cache
def _finger(name: str) -> Fingertip:
    return load("finger", finger(name, stiffening=_ANY), cached=False)


_surface = cache(FingertipSurface.fit)


@cache
def _under(name: str, shape: str) -> Under:
    config, indentor = finger(name, stiffening=_ANY), parse_shape(shape)
    surface = _surface(config.geometry)
    place = tuple({X: 0.0, Z: config.receptor_plane_mm}[axis] for axis in indentor.axes)
    return Under(config, surface, indentor, place, first_touch(indentor, place, surface))


if __name__ == "__main__":
    main(*sys.argv[1:])
