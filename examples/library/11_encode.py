"""Encode: press a step into the section of the finger, and say what receptors under it fire, with noise."""

import numpy as np
from numpy.typing import NDArray

from sim import FingertipConfig
from sim.coding.encoding import Encoded, Noise, Receptor, encode
from sim.coding.operators import convolution, impulse_responses, influence
from sim.coding.pressure import borne_by
from sim.coding.section import Sampling, sampled_section


def main(config: FingertipConfig, half_length: int = 24) -> tuple[Encoded, NDArray[np.float64]]:
    section = sampled_section(config, Sampling(half_length=half_length))  # receptors 0.17 mm apart, 0.76 mm deep
    pressed = section.finger.indent("step:1", -1.63, doi_mm=0.73)
    borne = borne_by(section, pressed)  # pressures at the skin's nodes, normal to it and along it

    by_elements = influence(section, borne.place_mm, borne.width_mm, "finite")  # no shift invariance assumed
    quiet = encode(by_elements, borne.stacked)
    receptor = Receptor(gain=30.0, threshold=0.1 * float(quiet.sed.max()))  # R = k (S − S₀), silent below S₀
    felt = encode(by_elements, borne.stacked, receptor, Noise(snr_db=20.0, at="receptor", seed=1))

    reach = int(min(-borne.place_mm[0], borne.place_mm[-1]) / section.sampling.spacing_mm)
    folded = convolution(impulse_responses(section), 2 * reach + 1, "finite")  # the source's P∗h, P∗g, P∗f
    by_convolution = encode(folded, borne.at(folded.place_mm))
    sed = np.interp(section.place_mm, folded.receptor_mm, by_convolution.sed)

    silent = int((felt.rate == 0).sum())
    print(f"M = {felt.samples} receptors, noise {felt.share_of_peak:.1%} of the peak, {silent} silent")
    for place, energy, folded_energy, rate in zip(section.place_mm, felt.sed, sed, felt.rate, strict=True):
        print(f"{place:6.2f} mm: SED {energy:6.2f}, by convolution {folded_energy:6.2f}, rate {rate:6.1f}")
    return felt, sed


if __name__ == "__main__":
    main(FingertipConfig())
