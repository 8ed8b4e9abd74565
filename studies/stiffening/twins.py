"""References beside the quick answer's inputs: linear twins on the same meshes, pressed by the simulator itself."""

from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.models.catalogue import load
from sim.models.errors import ModelRangeError
from sim.models.fingertip import Fingertip
from sim.models.results.indentation import IndentationResult
from sim.models.stiffening.at_finite_strain import Press
from studies.stiffening.fingers import finger

Array = NDArray[np.float64]

_ANY = 1.0  # stiffening of the finger that is asked how it is pressed; its linear twin is the same for all


class Pair(NamedTuple):
    """A press at finite strain, its linear twin, and the numbers by which the twin is corrected."""

    reference: Mapping[str, Any]
    linear: IndentationResult
    press: Press
    local: Array

    @property
    def log_force(self) -> float:
        """Of finite strain over the twin's."""
        return float(np.log(self.reference["force"] / self.linear.state.normal_force))

    @property
    def log_sed(self) -> Array:
        """(n,) the same of SED at the receptors."""
        return np.asarray(np.log(np.array(self.reference["sed"]) / self.linear_sed))

    @property
    def linear_sed(self) -> Array:
        """(n,) of the twin, pseudo-units."""
        return self.linear.model.measures(self.linear.receptor_strain)["sed"]


def pairs(references: Iterable[Mapping[str, Any]]) -> Iterator[Pair]:
    """Of all references whose twin stays on its patch."""
    for row in references:
        twin = _twin(row["finger"], row["shape"], row["doi_mm"])
        if twin is not None:
            yield Pair(row, twin, twin.strained.press, twin.strained.local)


@cache
def _finger(name: str) -> Fingertip:
    return load("finger", finger(name, stiffening=_ANY), cached=False)


@cache
def _twin(name: str, shape: str, doi_mm: float) -> IndentationResult | None:
    try:
        return _finger(name).indent(shape, doi_mm=doi_mm)
    except ModelRangeError:
        return None
