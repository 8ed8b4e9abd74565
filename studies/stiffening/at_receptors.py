"""What else receptors have at finite strain, beside the quick answer and its linear twin: strains and stresses.

    OMP_NUM_THREADS=1 .venv/bin/python -m studies.stiffening.at_receptors default flat 0.3     # half a minute

Root mean square of the logarithm, over the receptors above 0.3 of the highest SED.
"""

import sys
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from sim.models.catalogue import load
from studies.finite_strain.reading import Reader
from studies.finite_strain.solver.laws import Yeoh
from studies.finite_strain.solver.press import presses
from studies.finite_strain.solver.scene import Specimen
from studies.stiffening.fingers import finger

Array = NDArray[np.float64]

MEASURES = ("ep1", "ep3", "sp1", "mean", "sed")
DEPTHS_MM = (0.5, 1.0, 1.5, 2.0)
_STEP_MM = 0.25
_HEARD = 0.3


def off(reference: Array, found: Array, sed: Array) -> float:
    """Of a measure (n,) at receptors with some (n,) SED."""
    heard = sed > _HEARD * sed.max()
    return float(np.sqrt(np.mean(np.log(found[heard] / reference[heard]) ** 2)))


def rows(name: str, shape: str, stiffening: float) -> Iterator[tuple[float, dict[str, tuple[float, float]]]]:
    """Depth, and how far twin and quick answer are off in each measure."""
    config, law = finger(name, stiffening=stiffening), Yeoh(stiffening)
    specimen, quick = Specimen(config), load("finger", config, cached=False)
    body, reader, touch = specimen.body(law), Reader(specimen), specimen.touch(shape)
    for found in presses(body, specimen.skin, touch, DEPTHS_MM, _STEP_MM):
        true = reader.read(found, touch, law, body.displacement(found.unknowns))["measures"]
        press, sed = quick.indent(shape, doi_mm=found.doi_mm), np.array(true["sed"])
        both = press.model.measures(press.receptor_strain), press.receptor_measures
        linear, stiff = ({one: off(np.array(true[one]), each[one], sed) for one in MEASURES} for each in both)
        yield found.doi_mm, {one: (linear[one], stiff[one]) for one in MEASURES}


def main(name: str, shape: str, stiffening: str) -> None:
    """Print a table."""
    print(f"| mm | {' | '.join(MEASURES)} |", "|---" * (1 + len(MEASURES)) + "|", sep="\n")
    for doi_mm, errors in rows(name, shape, float(stiffening)):
        cells = (f"{100 * linear:.0f}, {100 * stiff:.0f} %" for linear, stiff in errors.values())
        print(f"| {doi_mm:g} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
