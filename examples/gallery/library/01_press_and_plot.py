"""
Press and plot
==============

You get the pressure on the skin and the strain energy density at ten receptors under a bar. The script presses the
bar 0.5 mm deep into the middle of the finger.

How-to: :doc:`/library`. Reference: :doc:`/python_names`, :doc:`/shapes`.
"""

import matplotlib.pyplot as plt

from sim import Fingertip, FingertipConfig, MeshSpec

finger = Fingertip.load(FingertipConfig(mesh=MeshSpec(level="coarse")))  # built once, then read from the cache
result = finger.indent("bar:3.0", x_mm=0.0, doi_mm=0.5)
((left_mm, right_mm),) = result.contact_regions_mm
print(f"{result.force_gwt:.2f} gwt, contact from x = {left_mm:.2f} to {right_mm:.2f} mm")

figure, (skin, receptors) = plt.subplots(2, sharex=True, layout="constrained")
skin.plot(*result.pressure_profile_kpa)
skin.set_ylabel("pressure (kPa)")
table = result.receptor_table()
receptors.plot(table["x_mm"], table["sed"], "o-")
receptors.set(xlabel="x (mm)", ylabel="strain energy density (pseudo-units)", xlim=(-4, 4))
plt.show()
