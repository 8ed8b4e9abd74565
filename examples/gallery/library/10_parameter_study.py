"""
A parameter study in Python
===========================

You get the force of the same press on six fingers that differ in two parameters. All answers are in one tidy table.

``rig study`` does this from a file, on many cores or machines. How-to: :doc:`/parameter_studies`. Reference:
:doc:`/configuration`.
"""

import itertools

import matplotlib.pyplot as plt
import numpy as np

from sim import Fingertip, FingertipConfig, MeshSpec, Tissue, indent_many

epidermis_mm, bone_fraction = (0.3, 0.4, 0.5), (0.26, 0.38)
mesh = MeshSpec(spacing_mm=0.5, axial_spacing_mm=0.8)  # coarse: six fingers are built
tables = []
for thickness, bone in itertools.product(epidermis_mm, bone_fraction):
    finger = Fingertip.load(FingertipConfig(mesh=mesh, tissue=Tissue(epidermis_mm=thickness, bone_fraction=bone)))
    found = indent_many(finger, ["cylinder:9"], doi_mm=0.4)
    varied = {"epidermis_mm": thickness, "bone_fraction": bone}
    tables.append({name: np.full(len(found), value) for name, value in varied.items()} | found.table())
study = {name: np.concatenate([table[name] for table in tables]) for name in tables[0]}

figure, axes = plt.subplots(layout="constrained")
for bone in bone_fraction:
    rows = study["bone_fraction"] == bone
    axes.plot(study["epidermis_mm"][rows], study["force_gwt"][rows], "o-", label=f"bone fraction {bone}")
axes.set(xlabel="thickness of the epidermis (mm)", ylabel="force at 0.4 mm (gwt)")
axes.legend()
plt.show()
