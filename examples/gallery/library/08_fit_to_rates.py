"""
Fit a measure to discharge rates
================================

You get the gain and the threshold of R = max(0, k (ε − ε₀)), fitted to a profile of discharge rates. The rates here
are synthetic: replace them by your own recording.

``rig compare`` does this for all measures and receptors. How-to: :doc:`/comparison`. Explanation: :doc:`/statistics`.
"""

import matplotlib.pyplot as plt
import numpy as np

from rig.compare.fit import fit_rates, predicted
from sim import Fingertip, FingertipConfig, MeshSpec, indent_many

RECEPTOR = 5  # of ten
position_mm = np.linspace(-2.0, 2.0, 17)  # indentor minus receptive field
finger = Fingertip.load(FingertipConfig(mesh=MeshSpec(level="coarse")))
found = indent_many(finger, "bar:1.5", position_mm, doi_mm=0.4)
eps = np.array([result.receptor_measures["sed"][RECEPTOR] for result in found if result is not None])

# SYNTHETIC, no recording: up to 80 spikes/s, silent below a quarter of the highest SED, with Poisson noise.
mean_rate = np.maximum(0.0, 80.0 * (eps / eps.max() - 0.25) / 0.75)
synthetic_rate = np.random.default_rng(0).poisson(mean_rate).astype(np.float64)

fit = fit_rates(eps, synthetic_rate)
r = np.corrcoef(synthetic_rate, predicted(fit, eps))[0, 1]
print(f"k = {fit.k:.3g} per pseudo-unit, ε₀ = {fit.eps0:.3g}, r = {r:.3f}")

figure, axes = plt.subplots(layout="constrained")
axes.plot(position_mm, synthetic_rate, "o", label="synthetic rates")
axes.plot(position_mm, predicted(fit, eps), label="fit to SED")
axes.set(xlabel="position of the bar (mm)", ylabel="rate (spikes/s)")
axes.legend()
plt.show()
