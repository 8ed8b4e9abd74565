"""Curvature of cylinders from decoded pressures, both ways: the source's formula inverted, and the skin less d.

    .venv/bin/python -m studies.coding.curvature_read_back [DRAWS]

Pressures of the section are read back at 30 dB from presses on a finer mesh; the section's compliance turns them into
displacement d. Eq. 4.1 then gives C, relative to the finger's own curvature; and the skin less d is an outline, whose
circle needs no formula.
"""

import sys
from collections.abc import Iterator
from functools import cache

import numpy as np
from numpy.typing import NDArray

from rig.compare.pressure_formula import Constants, curvature_at, finger_curvature, fit, together
from sim.coding.bayes import decode_profile
from sim.coding.encoding import noise_sd
from sim.coding.operators import centred
from sim.coding.pressure import Frictionless, SectionSkin, frictionless
from sim.coding.receptor_readings import Readings
from sim.coding.section import SPACING_MM, SampledSection
from sim.coding.shape_class import classify_shape
from sim.contact.patch import X, Y
from studies.coding.profiles_read_back import (
    SAMPLES,
    SNR_DB,
    ProfilePress,
    default_section,
    finer_section,
    pressed,
)
from studies.registry import show
from studies.source.pressure_fits import centred as centred_presses

Array = NDArray[np.float64]

DIAMETERS_MM = (2.5, 4.0, 6.0, 9.0, 15.0)
DEPTHS_MM = (0.5, 0.8)
DRAWS, SEED = 8, 8000
HEADER = (
    "cylinder, mm", "DOI, mm", "true, 1/mm", "skin less d", "Eq. 4.1", "skin less d, true pressures",
    "Eq. 4.1, true pressures",
)  # fmt: skip
_PRESSED = 0.2  # of the highest: in contact
_FROM_END = 2  # samples: as far as the formula is not for

Row = tuple[str, ...]


def main(draws: int = DRAWS) -> None:
    """Print the table and the constants."""
    print("K1, K2, K3: " + ", ".join(f"{k:.0f}" for k in constants()))
    show(HEADER, rows(draws))


def rows(draws: int) -> Iterator[Row]:
    """One row for each cylinder and depth: means, and sds over draws of the noise."""
    finer = finer_section()
    for diameter in DIAMETERS_MM:
        for doi_mm in DEPTHS_MM:
            true, sed = pressed(finer, ProfilePress(f"cylinder:{diameter:g}", 0.2, doi_mm))
            sd = noise_sd(sed, SNR_DB)
            found = []
            for k in range(draws):
                said = sed + sd * np.random.default_rng(SEED + k).normal(size=len(sed))
                found.append(both(decode_profile(default_operator(), Readings.of_sed(said, sd)).pressure))
            yield (
                f"{diameter:g}",
                f"{doi_mm:g}",
                f"{2 / diameter:.2f}",
                *(_told(np.array(way)) for way in zip(*found, strict=True)),
                *(f"{value:.2f}" if np.isfinite(value) else "–" for value in both(true)),
            )


def _told(values: Array) -> str:
    """Of the draws that told it."""
    known = values[np.isfinite(values)]
    return f"{known.mean():.2f} ± {known.std():.2f}" if len(known) else "–"


def both(pressure: Array) -> tuple[float, float]:
    """Curvature in 1/mm by the circle on the skin less its displacement, and by Eq. 4.1; nan where it is not told."""
    skin = default_operator().skin
    felt = classify_shape(skin, pressure)
    by_skin = 2 / felt.size_mm if felt.name == "cylinder" else np.nan
    inside, down = displaced(skin, pressure)
    if not inside.any():
        return by_skin, np.nan
    relative = curvature_at(down[inside], pressure[inside], constants())
    x_mm = 0.5 * (skin.at_rest_mm[X, 1:] + skin.at_rest_mm[X, :-1])[inside]
    section = _same()
    return by_skin, relative - float(finger_curvature(section.line.surface, x_mm, section.line.plane_mm).mean())


def displaced(skin: SectionSkin, pressure: Array) -> tuple[NDArray[np.bool_], Array]:
    """(n,) samples well inside contact, and how far each is pressed down: compliance × pressure; mm."""
    beyond = np.convolve(pressure <= _PRESSED * pressure.max(), np.ones(2 * _FROM_END + 1), mode="same")
    ends = skin.pressed(pressure, skin.lean(pressure) * pressure) - skin.at_rest_mm
    return beyond == 0, -0.5 * (ends[Y, 1:] + ends[Y, :-1])


@cache
def constants() -> Constants:
    """Of the formula on the section, over centred bars and cylinders."""
    return fit(together([one.row.off_edges for one in centred_presses(_same().finger)]))


@cache
def _same() -> SampledSection:
    return default_section()


@cache
def default_operator() -> Frictionless:
    """By which the default mesh decodes whole profiles."""
    return frictionless(_same(), centred(SAMPLES + 1, SPACING_MM), "finite")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
