"""
Encode: from pressure to receptor responses
===========================================

You get the strain energy density at receptors under a step, and the rates of model receptors with noise. Two methods
compute the density: element by element, and by convolution, which assumes that the finger is shift-invariant.

How-to: :doc:`/coding`.
"""

import matplotlib.pyplot as plt
import numpy as np

from sim import FingertipConfig, MeshSpec
from sim.coding.encoding import Noise, Receptor, encode
from sim.coding.operators import convolution, impulse_responses, influence
from sim.coding.pressure import contact_pressure
from sim.coding.section import Sampling, sampled_section

config = FingertipConfig(mesh=MeshSpec(level="coarse"))
section = sampled_section(config, Sampling(half_length=20))  # receptors 0.17 mm apart, 0.76 mm deep
borne = contact_pressure(
    section, section.finger.indent("step:1", -1.63, doi_mm=0.73)
)  # pressures at the skin's nodes

operator = influence(section, borne.place_mm, borne.width_mm, "finite")
quiet = encode(operator, borne.stacked)
receptor = Receptor(gain=2.0, threshold=0.1 * float(quiet.sed.max()))  # R = k (S − S₀), silent below S₀
noisy = encode(operator, borne.stacked, receptor, Noise(snr_db=20.0, at="receptor", seed=1))

reach = int(min(-borne.place_mm[0], borne.place_mm[-1]) / section.sampling.spacing_mm)
folded = convolution(impulse_responses(section), 2 * reach + 1, "finite")
sed = np.interp(section.place_mm, folded.receptor_mm, encode(folded, borne.at(folded.place_mm)).sed)

figure, (density, rates) = plt.subplots(2, sharex=True, layout="constrained")
density.plot(section.place_mm, quiet.sed, label="element by element")
density.plot(section.place_mm, sed, "--", label="by convolution")
density.set_ylabel("strain energy density (pseudo-units)")
density.legend()
rates.plot(section.place_mm, noisy.rate, "o")
rates.set(xlabel="receptor location along the skin (mm)", ylabel="rate (model, 1/s)")
plt.show()
