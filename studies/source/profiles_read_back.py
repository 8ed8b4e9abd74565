"""Whole pressure profiles read back from noisy SED: how wrong, how sure, and which part of it is whose fault.

    .venv/bin/python -m studies.source.profiles_read_back [DRAWS]

Decoded by influence, normal pressures alone, on 39 samples 170 µm apart, at 30 dB over M receptors. Readings are of
the same mesh under the normal pressures alone, of the same mesh under all of a press, and of the finer mesh.
"""

import sys
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sim.coding.borne import Borne, borne_by
from sim.coding.decoded import decoding_errors
from sim.coding.encoding import noise_sd
from sim.coding.operators import Operator, centred, influence
from sim.coding.profile_decoder import decode_profile
from sim.coding.readings import Readings
from sim.coding.sampled_section import SampledSection, Sampling, sampled_section
from sim.config.fingertip_config import FingertipConfig, MeshSpec

Array = NDArray[np.float64]

SCENES = {"cylinder:9": 0.0, "cylinder:3": 0.0, "bar:3.0": 0.0, "bar:1.5": 0.0, "step:1": -1.63, "step:5": -1.63}
DOI_MM, SAMPLES, SNR_DB, DRAWS = 0.67, 39, 30.0, 10
_PRESSED = 0.02  # of the peak: inside the contact


def main(draws: int = DRAWS) -> None:
    """Print relative L2, coverage of the 90 % band inside the contact, and its median width over the peak."""
    same = sampled_section(FingertipConfig(), Sampling())
    finer = sampled_section(FingertipConfig(mesh=MeshSpec(level="fine")), Sampling())
    spacing = same.sampling.spacing_mm
    place = centred(SAMPLES, spacing)
    both = influence(same, place, np.full(SAMPLES, spacing), "finite")
    normal = replace(both, parts=both.parts[:, :, :SAMPLES], place_mm=place)
    print(f"M = {both.parts.shape[1]} receptors, {draws} draws a row")
    print("| shape | readings | relative L2 | coverage | width over peak |\n|---|---|---|---|---|")
    for shape, x_mm in SCENES.items():
        for name, (true, sed) in _readings(same, finer, normal, shape, x_mm).items():
            print(f"| {shape} | {name} | {_row(normal, true, sed, draws)} |", flush=True)


def _readings(
    same: SampledSection, finer: SampledSection, normal: Operator, shape: str, x_mm: float
) -> dict[str, tuple[Array, Array]]:
    """Mean pressures over the samples, and the SED without noise that they are read back from."""
    found = {}
    for name, section in (("same mesh", same), ("finer mesh", finer)):
        pressed = section.finger.indent(shape, x_mm, doi_mm=DOI_MM)
        found[name] = (_means(borne_by(section, pressed)), pressed.receptor_measures["sed"])
    true = found["same mesh"][0]
    return {"same mesh, normal alone": (true, normal.sed(true)), **found}


def _means(borne: Borne) -> Array:
    """(SAMPLES,) pressures: the force on each sample, over its width."""
    place = centred(SAMPLES + 1, Sampling().spacing_mm)
    ends = np.append(borne.place_mm - borne.width_mm / 2, borne.place_mm[-1] + borne.width_mm[-1] / 2)
    force = np.append(0.0, np.cumsum(borne.normal * borne.width_mm))
    return np.asarray(np.diff(np.interp(place, ends, force)) / np.diff(place))


def _row(normal: Operator, true: Array, sed: Array, draws: int) -> str:
    sd, inside = noise_sd(sed, SNR_DB), true > _PRESSED * true.max()
    wrong, held, width = np.empty((3, draws))
    for k in range(draws):
        said = sed + sd * np.random.default_rng(k).normal(size=len(sed))
        found = decode_profile(normal, Readings.of_sed(said, sd))
        low, high = found.band()
        wrong[k] = decoding_errors(true, found.pressure).relative_l2
        held[k] = ((low <= true) & (true <= high))[inside].mean()
        width[k] = np.median((high - low)[inside]) / true.max()
    return (
        f"{100 * wrong.mean():.0f} ± {100 * wrong.std(ddof=1):.0f} % | {100 * held.mean():.0f} % | {width.mean():.2f}"
    )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
