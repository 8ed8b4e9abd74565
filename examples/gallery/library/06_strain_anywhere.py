"""
Strain at any point
===================

You get a map of strain energy density in the skin under a cylinder. Press once, then request strain, stress and
measures at any points inside the finger.

How-to: :doc:`/library`. Reference: :doc:`/python_names`.
"""

import matplotlib.pyplot as plt
import numpy as np

from sim import Fingertip, FingertipConfig, MeshSpec

finger = Fingertip.load(FingertipConfig(mesh=MeshSpec(level="coarse")))
result = finger.indent("cylinder:3", doi_mm=0.3)

x_mm, depth_mm = np.linspace(-2.0, 2.0, 33), np.linspace(0.1, 2.0, 16)
sheet = finger.points_below(x_mm, depth_mm[:, None])  # (depths, x, 3)
fields = finger.fields(result, sheet)  # also .strain and .stress (depths, x, 6), and .table()
sed = fields.measures["sed"]  # (depths, x)
print(f"The highest SED is {sed.max():.3g}, {depth_mm[sed.max(axis=1).argmax()]:.2f} mm below the skin.")

figure, axes = plt.subplots(layout="constrained")
shown = axes.pcolormesh(x_mm, depth_mm, sed, shading="gouraud")
axes.invert_yaxis()
axes.set(xlabel="x (mm)", ylabel="depth below the skin (mm)")
figure.colorbar(shown, label="strain energy density")
plt.show()
