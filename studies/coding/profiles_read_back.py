"""Whole pressure profiles read back from noisy SED: how wrong, how sure, and which part of it is whose fault.

    .venv/bin/python -m studies.coding.profiles_read_back [DRAWS] [chosen | snr]

Decoded on 39 samples 170 µm apart, at 30 dB over M receptors, from SED of presses on a finer mesh. With `chosen`: the
scenes and seeds on which the prior was chosen, which are none of those reported. With `snr`: against noise, beside a
bound and cheaper decoders.
"""

import sys
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.coding.bayes import Profile, decode_profile
from sim.coding.decoder_results import decoding_errors
from sim.coding.decoders_by_search import PressureRange, converged_search, global_search
from sim.coding.encoding import noise_sd
from sim.coding.model_averaging import table_of
from sim.coding.operators import centred
from sim.coding.pressure import Frictionless, contact_pressure, frictionless
from sim.coding.receptor_readings import Readings
from sim.coding.section import SPACING_MM, SampledSection, Sampling, sampled_section
from sim.config import FingertipConfig, MeshSpec
from studies.coding.limits import profile_bound

Array = NDArray[np.float64]


class ProfilePress(NamedTuple):
    """A press; mm."""

    shape: str
    x_mm: float
    doi_mm: float


SCENES = [
    ProfilePress("cylinder:9", 0.0, 0.67),
    ProfilePress("cylinder:3", 0.0, 0.67),
    ProfilePress("bar:3.0", 0.0, 0.67),
    ProfilePress("bar:1.5", 0.0, 0.67),
    ProfilePress("step:1", -1.63, 0.67),
    ProfilePress("step:5", -1.63, 0.67),
]
CHOSEN_ON = [
    ProfilePress("cylinder:6", 0.4, 0.5),
    ProfilePress("cylinder:4", -0.5, 0.9),
    ProfilePress("cylinder:15", 0.2, 0.8),
    ProfilePress("bar:2.0", -0.5, 0.8),
    ProfilePress("bar:2.4", 0.3, 0.5),
    ProfilePress("bar:1.2", 0.7, 0.6),
    ProfilePress("step:3", -1.2, 0.6),
    ProfilePress("step:1", -1.0, 0.8),
    ProfilePress("step:5", -0.6, 0.8),
]
SEED, CHOSEN_SEED = 1000, 100
SAMPLES, SNR_DB, DRAWS = 39, 30.0, 20
SNRS_DB = (0.0, 10.0, 20.0, 30.0, 40.0)
OURS = "within contacts, frictionless"
PRESSED = 0.02  # of the peak: inside the contact
WITHIN = PressureRange(0.0, 3000.0)
BASELINE_DRAWS, SLOW_DRAWS = 4, {"univariate": 1}  # that one takes seconds a decode
_ASIDE_MM, _DEEPER_MM = 0.02, 0.02  # of the differences that the bound's slopes are taken by
_HEAD = "| shape | pressures | relative L2 | coverage | width over peak | ms |\n|---|---|---|---|---|---|"

Decode = Callable[[Readings], Profile]


def main(draws: int = DRAWS, scenes: list[ProfilePress] = SCENES, seed: int = SEED) -> None:
    """Print relative L2, coverage of the 90 % band inside the contact, its median width over the peak, and time."""
    same, finer = default_section(), finer_section()
    operator = frictionless(same, centred(SAMPLES + 1, SPACING_MM), "finite")
    print(f"M = {operator.parts.shape[1]} receptors, {draws} draws a row, seeds {seed} … {seed + draws - 1}\n{_HEAD}")
    for scene in scenes:
        true, sed = pressed(finer, scene)
        for name, decode in decoders(operator).items():
            row = ProfileRow.of([read_back(decode, true, sed, SNR_DB, seed + k) for k in range(draws)])
            print(f"| {scene.shape} at {scene.x_mm:g}, {scene.doi_mm:g} mm deep | {name} | {row} |", flush=True)


def against_noise(draws: int) -> None:
    """Print the same of ours at other SNRs, a bound, and errors and times of cheaper decoders."""
    finer, operator = finer_section(), frictionless(default_section(), centred(SAMPLES + 1, SPACING_MM), "finite")
    ours, others = decoders(operator)[OURS], baselines(operator)
    head = "| shape | SNR (dB) | ours | coverage | width over peak | ms | bound | " + " | ".join(others) + " |"
    print(f"{draws} draws a cell, seeds {SEED} …; of cheaper decoders the first {BASELINE_DRAWS} or less\n{head}")
    print("|---" * head.count(" | ") + "|---|")
    held = []
    for scene in SCENES:
        true, sed = pressed(finer, scene)
        slopes = _slopes(finer, scene)
        for snr_db in SNRS_DB:
            seeds = range(SEED, SEED + draws)
            row = ProfileRow.of([read_back(ours, true, sed, snr_db, seed) for seed in seeds])
            held.append(row.mean.held)
            bound = profile_bound(true, *slopes, noise_sd(sed, snr_db))
            cells = [
                _cheaper(decode, true, sed, snr_db, seeds[: SLOW_DRAWS.get(name, BASELINE_DRAWS)])
                for name, decode in others.items()
            ]
            told = " | ".join([str(row), f"{100 * bound:.1f} %", *cells])
            print(f"| {scene.shape} | {snr_db:g} | {told} |", flush=True)
    print(f"\ncoverage pooled {np.mean(held):.1%}, of single cells {min(held):.0%} and more")


def baselines(operator: Frictionless) -> dict[str, Callable[[Readings], Array]]:
    """Decoders that know less, or search for less; all but the look-up with upright forces."""
    upright, table = operator.leaning(np.zeros(len(operator.place_mm))), table_of(operator)
    even = np.full(len(operator.place_mm), WITHIN.high / 30)

    def looked_up(readings: Readings) -> Array:
        along = table.sed @ readings.sed
        nearest = int(along.argmax())
        return np.asarray(np.sqrt(max(0.0, along[nearest])) * table.pressure[nearest])

    return {
        "smooth": lambda readings: decode_profile(upright, readings, prior="smooth").pressure,
        "look-up": looked_up,
        "dual annealing": lambda readings: global_search(upright, readings.sed, WITHIN).pressure,
        "univariate": lambda readings: converged_search(upright, readings.sed, even, WITHIN).pressure,
    }


def _cheaper(decode: Callable[[Readings], Array], true: Array, sed: Array, snr_db: float, seeds: range) -> str:
    error, began, sd = [], time.process_time(), noise_sd(sed, snr_db)
    for seed in seeds:
        said = Readings.of_sed(sed + sd * np.random.default_rng(seed).normal(size=len(sed)), sd)
        error.append(decoding_errors(true, decode(said)).relative_l2)
    return f"{100 * np.mean(error):.0f} %, {1e3 * (time.process_time() - began) / len(seeds):.0f} ms"


def _slopes(section: SampledSection, scene: ProfilePress) -> tuple[Array, Array]:
    """(n, 2) of pressures and (m, 2) of SED, per mm of place and of depth."""
    x, doi = scene.x_mm, scene.doi_mm
    ends = [
        (scene._replace(x_mm=x + _ASIDE_MM), scene._replace(x_mm=x - _ASIDE_MM), _ASIDE_MM),
        (scene._replace(doi_mm=doi + _DEEPER_MM), scene._replace(doi_mm=doi - _DEEPER_MM), _DEEPER_MM),
    ]
    each = [
        [(high - low) / (2 * apart) for high, low in zip(pressed(section, a), pressed(section, b), strict=True)]
        for a, b, apart in ends
    ]
    pressure, sed = (np.stack(columns, axis=1) for columns in zip(*each, strict=True))
    return pressure, sed


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


def pressed(section: SampledSection, scene: ProfilePress) -> tuple[Array, Array]:
    """(SAMPLES,) mean normal pressures, and the SED without noise that they are read back from."""
    press = section.finger.indent(scene.shape, scene.x_mm, doi_mm=scene.doi_mm)
    return contact_pressure(section, press).means(centred(SAMPLES, SPACING_MM)), press.receptor_measures["sed"]


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
    began = time.thread_time()  # of this thread: others of a BLAS only wait, and would be counted too
    found = decode(said)
    spent_ms = 1e3 * (time.thread_time() - began)
    low, high = found.band()
    inside = true > PRESSED * true.max()
    held = ((low <= true) & (true <= high))[inside].mean()
    width = np.median((high - low)[inside]) / true.max()
    return ReadBack(decoding_errors(true, found.pressure).relative_l2, float(held), float(width), spent_ms)


class ProfileRow(NamedTuple):
    """Over draws."""

    mean: ReadBack
    sd: ReadBack

    @classmethod
    def of(cls, draws: list[ReadBack]) -> "ProfileRow":
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
