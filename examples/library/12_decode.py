"""Decode: read the pressure on the skin back from noisy receptors that lie where they happen to, and say how sure."""

import numpy as np

from sim import FingertipConfig
from sim.coding.decoded import DecodingErrors, decoding_errors
from sim.coding.encoding import Noise, Receptor, encode
from sim.coding.fitted_receptor import FittedReceptor, decode_through
from sim.coding.operators import influence, normal_influence
from sim.coding.profile_decoder import Profile, decode_profile
from sim.coding.readings import Readings, sd_at_rest
from sim.coding.sampled_section import felt_section


def main(config: FingertipConfig, receptors: int = 30) -> tuple[Profile, DecodingErrors]:
    rng = np.random.default_rng(4)
    place_mm = np.sort(rng.uniform(-2.5, 2.5, receptors))  # along the skin; 0 is above x = 0
    section = felt_section(config, place_mm, rng.uniform(0.6, 0.9, receptors))

    skin_mm = np.linspace(-2.0, 2.0, 81)  # a dome of pressure, and the SED that it gives these receptors
    dome = 300 * np.sqrt(np.maximum(0.0, 1 - ((skin_mm - 0.3) / 1.1) ** 2))
    truth = influence(section, skin_mm, np.full(81, 0.05), "finite")
    said = encode(truth, np.append(dome, 0 * dome), None, Noise(snr_db=30.0, seed=2))
    sd = sd_at_rest(said.noise_sd * rng.normal(size=receptors))  # noise, from the same receptors with nothing on them

    found_mm = np.linspace(place_mm[0], place_mm[-1], receptors)
    operator = normal_influence(section, found_mm, 0.17, "finite")
    found = decode_profile(operator, Readings.of_sed(said.rate, sd))
    errors = decoding_errors(np.interp(found_mm, skin_mm, dome, left=0, right=0), found.pressure)

    low, high = found.band()
    print(f"{'converged' if found.converged else 'not converged'}, relative L2 {errors.relative_l2:.0%}")
    for place, pressure, least, most in zip(found_mm, found.pressure, low, high, strict=True):
        print(f"{place:6.2f} mm: {pressure:5.0f}, 90 % between {least:5.0f} and {most:5.0f} pseudo-units")

    rate = 30.0 * np.maximum(0.0, said.rate)  # of receptors whose gain is known to ± 2 alone: a wider band
    fitted = FittedReceptor(Receptor(gain=30.0), gain_se=2.0)
    wider = decode_through(fitted, lambda one: decode_profile(operator, Readings.of_rates(rate, one, sd)))
    print(f"from rates, 30 ± 2 each: the band is wider by {np.mean(wider.sd / found.sd) - 1:.0%}")
    return found, errors


if __name__ == "__main__":
    main(FingertipConfig())
