"""
Your own indentor
=================

You get the contact under an indentor whose profile you give as two arrays. This one is a shallow dome with a ripple.

A smooth monotone curve joins the points, or straight lines with ``linear=True``; ``profile:FILE.csv`` reads them from
a file. How-to: :doc:`/shapes`. Reference: :doc:`/python_names`.
"""

import matplotlib.pyplot as plt
import numpy as np

from sim import Fingertip, MeasuredProfile

x_mm = np.linspace(-2.0, 2.0, 81)  # rising; 0 is the reference point
height_mm = 0.1 * x_mm**2 + 0.02 * np.cos(8 * x_mm)  # above any level
dome = MeasuredProfile.from_arrays(x_mm, height_mm, name="rippled dome")

finger = Fingertip.load()
result = finger.indent(dome, x_mm=0.1, force_gwt=2.0)
print(f"{dome}: {result.doi_mm:.3f} mm deep, {len(result.contact_regions_mm)} regions")

figure, (shape, skin) = plt.subplots(2, sharex=True, layout="constrained")
shape.plot(x_mm + 0.1, height_mm)
shape.set_ylabel("profile (mm)")
skin.plot(*result.pressure_profile_kpa)
skin.set(xlabel="x (mm)", ylabel="pressure (kPa)", xlim=(-2.5, 2.5))
plt.show()
