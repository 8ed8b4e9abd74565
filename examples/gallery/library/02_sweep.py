"""
Move an indentor across the finger
==================================

You get the highest pressure at each of nine positions of a step, all pressed to the same force. One call to
``indent_many`` computes them; ``cores=2`` uses two processes.

How-to: :doc:`/library`. Reference: :doc:`/python_names`, :doc:`/shapes`.
"""

import matplotlib.pyplot as plt
import numpy as np

from sim import Fingertip, FingertipConfig, MeshSpec, indent_many

if __name__ == "__main__":  # with more than one core, processes import this script again
    finger = Fingertip.load(FingertipConfig(mesh=MeshSpec(level="coarse")))
    found = indent_many(finger, "step:1", np.linspace(2.0, -3.2, 9), force_gwt=2.33, cores=1)

    table = found.table()
    for x, peak, regions in zip(table["x_mm"], table["peak_pressure_kpa"], table["regions"], strict=True):
        print(f"x = {x:5.2f} mm: {peak:5.1f} kPa, {regions:.0f} regions")

    figure, axes = plt.subplots(layout="constrained")
    axes.plot(table["x_mm"], table["peak_pressure_kpa"], "o-")
    axes.set(xlabel="position of the step (mm)", ylabel="highest pressure (kPa)")
    plt.show()
