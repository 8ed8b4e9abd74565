"""How wrong the model's SED is between meshes, by shape: what `CONTACTS_ERROR` of the profile decoder is chosen by.

    .venv/bin/python -m studies.coding.bands.model_error [PRESSES]

SED of presses on the finer mesh, less what the mesh that decodes makes of their pressures, without noise; on the
seeds that are chosen on.
"""

import sys
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.coding.bayes import CONTACTS_ERROR, ModelError
from sim.coding.encoding import noise_sd
from sim.coding.operators import centred
from sim.coding.pressure import Frictionless, frictionless
from sim.coding.section import SPACING_MM
from studies.coding.bands.drawn_presses import CHOOSING_SEED, NEAR, Press, drawn
from studies.coding.profiles_read_back import SAMPLES, default_section, finer_section, pressed

Array = NDArray[np.float64]

PRESSES, SNR_DB, APART = 20, 40.0, 3
ERRORS = (ModelError(), CONTACTS_ERROR)
_FELT = 0.1  # of the highest SED: receptors whose error counts


class Wrong(NamedTuple):
    """Relative L2 of SED; over receptors that feel much the rms share, and how alike it is at `APART` receptors."""

    relative_l2: float
    share: float
    alike: float
    expected: tuple[float, ...]  # squared misfit over what is expected of it, noise in it, of each of `ERRORS`

    @classmethod
    def of(cls, operator: Frictionless, presses: list[Press]) -> "Wrong":
        """Over presses."""
        found, shares, along = [], [], []
        for true, sed in presses:
            off = sed - operator.sed(true)
            found.append(np.linalg.norm(off) / np.linalg.norm(sed))
            felt = off[sed > _FELT * sed.max()] / sed[sed > _FELT * sed.max()]
            shares.append(np.mean(felt**2))
            along.append(np.mean(felt[APART:] * felt[:-APART]))
        expected = tuple(float(np.mean([_misfit(operator, error, *one) for one in presses])) for error in ERRORS)
        return cls(
            float(np.mean(found)), float(np.sqrt(np.mean(shares))), float(np.mean(along) / np.mean(shares)), expected
        )

    def __str__(self) -> str:
        told = " | ".join(f"{value:.2f}" for value in (self.alike, *self.expected))
        return f"{self.relative_l2:.1%} | {self.share:.1%} | {told}"


def main(presses: int = PRESSES) -> None:
    """Print a row for each shape."""
    named = " | ".join(f"misfit, {error.share:.0%} over {error.length_mm:g} mm" for error in ERRORS)
    head = f"shape | relative L2 | where felt | alike {APART * SPACING_MM:.1f} mm apart | {named}"
    print(f"{presses} presses a shape, seeds {CHOOSING_SEED} …\n| {head} |\n{'|---' * (4 + len(ERRORS))}|")
    operator, finer = frictionless(default_section(), centred(SAMPLES + 1, SPACING_MM), "finite"), finer_section()
    for kind, name in enumerate(NEAR.kinds):
        known = [pressed(finer, scene) for scene in drawn(NEAR, kind, presses, CHOOSING_SEED)]
        print(f"| {name} | {Wrong.of(operator, known)} |", flush=True)


def _misfit(operator: Frictionless, error: ModelError, true: Array, sed: Array) -> float:
    """Over the number of receptors; 1 where errors are as large as they are said to be."""
    there, noise = operator.sed(true), noise_sd(sed, SNR_DB) ** 2
    covariance = noise * np.eye(len(sed)) + error.covariance(operator, there) + operator.unsure(true)
    off = sed - there
    inverse = np.linalg.inv(covariance)
    return float((off @ inverse @ off + noise * np.trace(inverse)) / len(sed))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
