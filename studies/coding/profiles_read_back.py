"""Whole pressure profiles read back from noisy SED: how wrong, how sure, and which part of it is whose fault.

    .venv/bin/python -m studies.coding.profiles_read_back [DRAWS] [chosen | snr]

Decoded on 39 samples 170 µm apart, at 30 dB over M receptors, from SED of presses on a finer mesh. With `chosen`: the
scenes and seeds on which the prior was chosen, which are none of those reported. With `snr`: ours against noise.
"""

import sys
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.coding.borne import borne_by
from sim.coding.decoded import decoding_errors
from sim.coding.encoding import noise_sd
from sim.coding.frictionless import Frictionless, frictionless
from sim.coding.operators import centred
from sim.coding.profile_decoder import Profile, decode_profile
from sim.coding.readings import Readings
from sim.coding.sampled_section import SPACING_MM, SampledSection, Sampling, sampled_section
from sim.config.fingertip_config import FingertipConfig, MeshSpec

Array = NDArray[np.float64]


class Scene(NamedTuple):
    """A press; mm."""

    shape: str
    x_mm: float
    doi_mm: float


SCENES = [
    Scene("cylinder:9", 0.0, 0.67),
    Scene("cylinder:3", 0.0, 0.67),
    Scene("bar:3.0", 0.0, 0.67),
    Scene("bar:1.5", 0.0, 0.67),
    Scene("step:1", -1.63, 0.67),
    Scene("step:5", -1.63, 0.67),
]
CHOSEN_ON = [
    Scene("cylinder:6", 0.4, 0.5),
    Scene("cylinder:4", -0.5, 0.9),
    Scene("cylinder:15", 0.2, 0.8),
    Scene("bar:2.0", -0.5, 0.8),
    Scene("bar:2.4", 0.3, 0.5),
    Scene("bar:1.2", 0.7, 0.6),
    Scene("step:3", -1.2, 0.6),
    Scene("step:1", -1.0, 0.8),
    Scene("step:5", -0.6, 0.8),
]
SEED, CHOSEN_SEED = 1000, 100
SAMPLES, SNR_DB, DRAWS = 39, 30.0, 20
SNRS_DB = (0.0, 10.0, 20.0, 30.0, 40.0)
OURS = "within contacts, frictionless"
PRESSED = 0.02  # of the peak: inside the contact
_HEAD = "| shape | pressures | relative L2 | coverage | width over peak | ms |\n|---|---|---|---|---|---|"

Decode = Callable[[Readings], Profile]


def main(draws: int = DRAWS, scenes: list[Scene] = SCENES, seed: int = SEED) -> None:
    """Print relative L2, coverage of the 90 % band inside the contact, its median width over the peak, and time."""
    same, finer = default_section(), finer_section()
    operator = frictionless(same, centred(SAMPLES + 1, SPACING_MM), "finite")
    print(f"M = {operator.parts.shape[1]} receptors, {draws} draws a row, seeds {seed} … {seed + draws - 1}\n{_HEAD}")
    for scene in scenes:
        true, sed = pressed(finer, scene)
        for name, decode in decoders(operator).items():
            row = Row.of([read_back(decode, true, sed, SNR_DB, seed + k) for k in range(draws)])
            print(f"| {scene.shape} at {scene.x_mm:g}, {scene.doi_mm:g} mm deep | {name} | {row} |", flush=True)


def against_noise(draws: int) -> None:
    """Print the same of ours at other SNRs."""
    finer, operator = finer_section(), frictionless(default_section(), centred(SAMPLES + 1, SPACING_MM), "finite")
    print("| shape | SNR (dB) | relative L2 | coverage | width over peak | ms |\n|---|---|---|---|---|---|")
    for scene in SCENES:
        true, sed = pressed(finer, scene)
        for snr_db in SNRS_DB:
            row = Row.of([read_back(decoders(operator)[OURS], true, sed, snr_db, SEED + k) for k in range(draws)])
            print(f"| {scene.shape} | {snr_db:g} | {row} |", flush=True)


def default_section() -> SampledSection:
    """What decodes."""
    return sampled_section(FingertipConfig(), Sampling())


def finer_section() -> SampledSection:
    """What is pressed."""
    return sampled_section(FingertipConfig(mesh=MeshSpec(level="fine")), Sampling())


def decoders(operator: Frictionless) -> dict[str, Decode]:
    """Ours, then with less and less of what it knows."""
    upright = operator.leaning(np.zeros(len(operator.place_mm)))
    return {
        OURS: lambda readings: decode_profile(operator, readings),
        "within contacts, normal alone": lambda readings: decode_profile(upright, readings),
        "smooth, normal alone": lambda readings: decode_profile(upright, readings, prior="smooth"),
    }


def pressed(section: SampledSection, scene: Scene) -> tuple[Array, Array]:
    """(SAMPLES,) mean normal pressures, and the SED without noise that they are read back from."""
    press = section.finger.indent(scene.shape, scene.x_mm, doi_mm=scene.doi_mm)
    return borne_by(section, press).means(centred(SAMPLES, SPACING_MM)), press.receptor_measures["sed"]


class ReadBack(NamedTuple):
    """One draw: relative L2, share of the contact that the 90 % band holds, its width over the peak, ms."""

    relative_l2: float
    held: float
    width: float
    spent_ms: float


def read_back(decode: Decode, true: Array, sed: Array, snr_db: float, seed: int) -> ReadBack:
    """From one draw of noise."""
    sd = noise_sd(sed, snr_db)
    said = Readings.of_sed(sed + sd * np.random.default_rng(seed).normal(size=len(sed)), sd)
    began = time.process_time()
    found = decode(said)
    spent_ms = 1e3 * (time.process_time() - began)
    low, high = found.band()
    inside = true > PRESSED * true.max()
    held = ((low <= true) & (true <= high))[inside].mean()
    width = np.median((high - low)[inside]) / true.max()
    return ReadBack(decoding_errors(true, found.pressure).relative_l2, float(held), float(width), spent_ms)


class Row(NamedTuple):
    """Over draws."""

    mean: ReadBack
    sd: ReadBack

    @classmethod
    def of(cls, draws: list[ReadBack]) -> "Row":
        """Means and sds."""
        return cls(ReadBack(*np.mean(draws, axis=0).tolist()), ReadBack(*np.std(draws, axis=0, ddof=1).tolist()))

    def __str__(self) -> str:
        error = f"{100 * self.mean.relative_l2:.1f} ± {100 * self.sd.relative_l2:.1f} %"
        return f"{error} | {100 * self.mean.held:.0f} % | {self.mean.width:.2f} | {self.mean.spent_ms:.0f}"


if __name__ == "__main__":
    numbers = [int(word) for word in sys.argv[1:] if word.isdigit()] or [DRAWS]
    if "snr" in sys.argv:
        against_noise(numbers[0])
    elif "chosen" in sys.argv:
        main(numbers[0], CHOSEN_ON, CHOSEN_SEED)
    else:
        main(numbers[0])
