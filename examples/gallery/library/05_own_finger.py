"""
Your own finger
===============

You get a finger of your own shape from a table of sections along it, and force against depth under a cylinder. The
table here is synthetic; points of the skin serve as well, and both may come from a file.

How-to: :doc:`/your_own_finger`. Reference: :doc:`/configuration`.
"""

import matplotlib.pyplot as plt

from sim import Fingertip, FingertipConfig, Geometry, MeshSpec, indent_many

SYNTHETIC_SECTIONS = (  # z, half-width, height of the pulp above the bone's axis, lateral shift; mm
    (0.0, 4.0, 3.0, -0.6),
    (3.0, 4.9, 4.2, -0.5),
    (6.0, 5.1, 5.1, -0.2),
    (9.0, 4.8, 5.2, 0.1),
    (12.0, 3.6, 4.0, 0.1),
    (14.0, 1.1, 1.1, 0.0),
)
geometry = Geometry(length_mm=14.0, sections=SYNTHETIC_SECTIONS)
mesh = MeshSpec(spacing_mm=0.4, axial_spacing_mm=0.6)
config = FingertipConfig(geometry=geometry, receptor_plane_from_tip_mm=6.4, mesh=mesh)
finger = Fingertip.load(config)
print(f"The pulp is highest at {finger.apex_height_mm:.2f} mm.")

figure, (side, press) = plt.subplots(1, 2, layout="constrained")
side.plot([row[0] for row in SYNTHETIC_SECTIONS], [row[2] for row in SYNTHETIC_SECTIONS], "o-")
side.set(xlabel="z, along the finger (mm)", ylabel="height of the pulp (mm)")
table = indent_many(finger, "cylinder:9", doi_mm=[0.1, 0.2, 0.3, 0.4]).table()
press.plot(table["doi_mm"], table["force_gwt"], "o-")
press.set(xlabel="depth of indentation (mm)", ylabel="force (gwt)")
plt.show()
