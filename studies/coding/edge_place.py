"""How finely a row of receptors tells where an edge is: bias and sd, beside the Cramér–Rao bound.

    .venv/bin/python -m studies.coding.edge_place [DRAWS]

The left edge of a bar 2.0, at places within one sample, pressed 0.9 mm on a finer mesh. The bound is of an unbiased
reader who knows the bar and its width, not its place and depth.
"""

import sys
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from sim.coding.bayes import decode_profile
from sim.coding.encoding import noise_sd
from sim.coding.operators import at_receptors, centred
from sim.coding.pressure import frictionless
from sim.coding.receptor_readings import Readings
from sim.coding.section import SPACING_MM, SampledSection
from sim.coding.shape_class import edges_mm
from studies.coding.profiles_read_back import SAMPLES, default_section, finer_section
from studies.registry import show

Array = NDArray[np.float64]

WIDTH_MM, DOI_MM = 2.0, 0.9
PLACES_MM = SPACING_MM * np.linspace(-0.5, 0.5, 6)
EVERY, SNRS_DB, DRAWS, SEED = (1, 2, 4, 7), (20.0, 30.0, 40.0), 4, 5000
HEADER = ("receptors apart", "SNR (dB)", "bias, µm", "sd, µm", "bound, µm")
_ASIDE_MM, _DEEPER_MM = SPACING_MM, 0.05  # of the differences that the bound's slopes are taken by


def main(draws: int = DRAWS) -> None:
    """Print bias, sd and bound in micrometres."""
    print(f"{draws} draws at each of {len(PLACES_MM)} places")
    show(HEADER, rows(draws))


def rows(draws: int) -> Iterator[tuple[str, ...]]:
    """One for each spacing and SNR."""
    finer, same = finer_section(), default_section()
    operator = frictionless(same, centred(SAMPLES + 1, SPACING_MM), "finite")
    sed = {x: felt(finer, x, DOI_MM) for x in PLACES_MM.tolist()}
    slopes = {x: _slopes(finer, x) for x in sed}
    for every in EVERY:
        at = slice((every - 1) // 2, None, every)
        there = at_receptors(operator, at)
        for snr_db in SNRS_DB:
            off, bound = [], []
            for x, whole in sed.items():
                sd = noise_sd(whole[at], snr_db)
                bound.append(sd * np.sqrt(np.linalg.inv(slopes[x][at].T @ slopes[x][at])[0, 0]))
                for k in range(draws):
                    said = whole[at] + sd * np.random.default_rng(SEED + k).normal(size=len(whole[at]))
                    found = decode_profile(there, Readings.of_sed(said, sd)).pressure
                    off.append(edges_mm(operator.skin, found)[0] - (x - WIDTH_MM / 2))
            cells = (1e3 * np.mean(off), 1e3 * np.std(off, ddof=1), 1e3 * np.mean(bound))
            yield f"{every * SPACING_MM:.2f} mm", f"{snr_db:g}", *(f"{v:.0f}" for v in cells)


def felt(section: SampledSection, x_mm: float, doi_mm: float) -> Array:
    """(m,) SED without noise."""
    press = section.finger.indent(f"bar:{WIDTH_MM}", x_mm, doi_mm=doi_mm)
    return np.asarray(press.receptor_measures["sed"])


def _slopes(section: SampledSection, x_mm: float) -> Array:
    """(m, 2) of SED, per mm of place and of depth."""
    aside = felt(section, x_mm + _ASIDE_MM, DOI_MM) - felt(section, x_mm - _ASIDE_MM, DOI_MM)
    deeper = felt(section, x_mm, DOI_MM + _DEEPER_MM) - felt(section, x_mm, DOI_MM - _DEEPER_MM)
    return np.stack([aside / (2 * _ASIDE_MM), deeper / (2 * _DEEPER_MM)], axis=1)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
