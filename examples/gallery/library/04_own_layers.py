"""
Your own layers
===============

You get force against depth for the default finger and for one with a thinner epidermis over softer fat. What you
leave out of ``Tissue`` keeps its default.

Explanation: :doc:`/model`. Reference: :doc:`/configuration`, :doc:`/python_names`.
"""

import matplotlib.pyplot as plt

from sim import Fingertip, FingertipConfig, MeshSpec, Tissue, indent_many

depths_mm = [0.1, 0.2, 0.3, 0.4, 0.5]
tissues = {"default": Tissue(), "thin epidermis, soft fat": Tissue(epidermis_mm=0.3, e_fat=0.05)}
force_gwt = {}
for name, tissue in tissues.items():
    finger = Fingertip.load(FingertipConfig(mesh=MeshSpec(spacing_mm=0.4, axial_spacing_mm=0.6), tissue=tissue))
    force_gwt[name] = indent_many(finger, "cylinder:9", doi_mm=depths_mm).table()["force_gwt"]
    print(f"{name}: {force_gwt[name][-1]:.2f} gwt at 0.5 mm")

figure, axes = plt.subplots(layout="constrained")
for name, forces in force_gwt.items():
    axes.plot(depths_mm, forces, "o-", label=name)
axes.set(xlabel="depth of indentation (mm)", ylabel="force (gwt)")
axes.legend()
plt.show()
