"""
Decode: from receptor responses to pressure
===========================================

You get the pressure on the skin, estimated from noisy readings of 30 receptors at random locations, with a 90 % band.
The pressure is synthetic. How-to: :doc:`/coding`.
"""

import matplotlib.pyplot as plt
import numpy as np

from sim import FingertipConfig, MeshSpec
from sim.coding.bayes import decode_profile
from sim.coding.decoder_results import decoding_errors
from sim.coding.encoding import Noise, encode
from sim.coding.pressure import frictionless
from sim.coding.receptor_readings import Readings, sd_at_rest
from sim.coding.section import receptor_section

rng = np.random.default_rng(4)
location_mm = np.sort(rng.uniform(-2.5, 2.5, 30))  # along the skin; 0 is above x = 0
section = receptor_section(FingertipConfig(mesh=MeshSpec(level="coarse")), location_mm, rng.uniform(0.6, 0.9, 30))

fine = frictionless(section, np.linspace(-2.0, 2.0, 81), "finite")  # pressures normal to the deformed skin
synthetic_dome = 300 * np.sqrt(np.maximum(0.0, 1 - ((fine.place_mm - 0.3) / 1.1) ** 2))
readings = encode(fine, synthetic_dome, None, Noise(snr_db=30.0, seed=2))
sd = sd_at_rest(readings.noise_sd * rng.normal(size=30))  # noise, from the same receptors under no load

operator = frictionless(section, np.linspace(-2.04, 2.04, 25), "finite")
found = decode_profile(operator, Readings.of_sed(readings.rate, sd))
errors = decoding_errors(np.interp(operator.place_mm, fine.place_mm, synthetic_dome), found.pressure)
print(f"converged: {found.converged}, relative L2 error {errors.relative_l2:.0%}")

figure, axes = plt.subplots(layout="constrained")
axes.fill_between(operator.place_mm, *found.band(), alpha=0.3, label="90 % band")
axes.plot(operator.place_mm, found.pressure, label="estimate")
axes.plot(fine.place_mm, synthetic_dome, "k--", label="synthetic pressure")
axes.set(xlabel="location along the skin (mm)", ylabel="pressure (pseudo-units)")
axes.legend()
plt.show()
