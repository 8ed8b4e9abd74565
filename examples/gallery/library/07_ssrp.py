"""
A spatial response profile
==========================

You get each of the 18 measures at one receptor, plotted against the position of a step (a spatial response profile).
Compression is plotted as positive.

How-to: :doc:`/comparison`. Reference: :doc:`/columns`, :doc:`/python_names`.
"""

import matplotlib.pyplot as plt
import numpy as np

from sim import MEASURES, Fingertip, FingertipConfig, MeshSpec, indent_many
from sim.measures.measures import shown

RECEPTOR = 3  # of ten
x_mm = np.linspace(2.0, -3.2, 14)
finger = Fingertip.load(FingertipConfig(mesh=MeshSpec(level="coarse")))
table = indent_many(finger, "step:1", x_mm, force_gwt=2.33).receptor_table()
mine = np.flatnonzero(table["receptor_x_mm"] == np.unique(table["receptor_x_mm"])[RECEPTOR])
profiles = {}
for measure in MEASURES:
    profiles[measure] = np.full(len(x_mm), np.nan)  # nan where there is no answer
    profiles[measure][table["indentation"][mine]] = shown(measure, table[measure][mine])

figure, axes = plt.subplots(3, 6, figsize=(14, 6), sharex=True, layout="constrained")
for panel, (measure, values) in zip(axes.flat, profiles.items(), strict=True):
    panel.plot(x_mm, values)
    panel.set_title(measure)
figure.supxlabel("position of the step (mm)")
plt.show()
