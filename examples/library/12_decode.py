"""Decode: read the pressure on the skin back from noisy receptors that lie where they happen to, and say how sure."""

import numpy as np

from sim import FingertipConfig
from sim.coding.bayes import FittedReceptor, Profile, decode_profile, decode_through
from sim.coding.decoding import DecodingErrors, decoding_errors
from sim.coding.encoding import Noise, Receptor, encode
from sim.coding.pressure import frictionless
from sim.coding.readings import Readings, sd_at_rest
from sim.coding.section import felt_section


def main(config: FingertipConfig, receptors: int = 30) -> tuple[Profile, DecodingErrors]:
    rng = np.random.default_rng(4)
    place_mm = np.sort(rng.uniform(-2.5, 2.5, receptors))  # along the skin; 0 is above x = 0
    section = felt_section(config, place_mm, rng.uniform(0.6, 0.9, receptors))

    fine = frictionless(section, np.linspace(-2.0, 2.0, 81), "finite")  # pressures normal to the deformed skin
    dome = 300 * np.sqrt(np.maximum(0.0, 1 - ((fine.place_mm - 0.3) / 1.1) ** 2))
    said = encode(fine, dome, None, Noise(snr_db=30.0, seed=2))
    sd = sd_at_rest(said.noise_sd * rng.normal(size=receptors))  # noise, from the same receptors with nothing on them

    operator = frictionless(section, np.linspace(-2.04, 2.04, 25), "finite")
    found = decode_profile(operator, Readings.of_sed(said.rate, sd))
    errors = decoding_errors(np.interp(operator.place_mm, fine.place_mm, dome), found.pressure)

    low, high = found.band()
    print(f"{'converged' if found.converged else 'not converged'}, relative L2 {errors.relative_l2:.0%}")
    for place, pressure, least, most in zip(operator.place_mm, found.pressure, low, high, strict=True):
        print(f"{place:6.2f} mm: {pressure:5.0f}, 90 % between {least:5.0f} and {most:5.0f} pseudo-units")

    rate = 30.0 * np.maximum(0.0, said.rate)  # of receptors whose gain is known to ± 4 alone: a wider band
    fitted = FittedReceptor(Receptor(gain=30.0), gain_se=4.0)
    wider = decode_through(fitted, lambda one: decode_profile(operator, Readings.of_rates(rate, one, sd)))
    print(f"from rates, 30 ± 4 each: the band is wider by {wider.sd.mean() / found.sd.mean() - 1:.0%}")
    return found, errors


if __name__ == "__main__":
    main(FingertipConfig())
