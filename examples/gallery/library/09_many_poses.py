"""
Many random presses
===================

You get depth against force for 80 random presses of three indentors, computed by one call. A press that cannot be
made becomes a row with the reason in the column ``problem``.

``cores=None`` uses all cores, ``write_csv`` writes the table. How-to: :doc:`/library`. Reference:
:doc:`/python_names`.
"""

import matplotlib.pyplot as plt
import numpy as np

from sim import Fingertip, FingertipConfig, MeshSpec, indent_many

POSES = 80
rng = np.random.default_rng(0)
shapes = rng.choice(["bar:3.0", "cylinder:9", "step:5"], POSES).tolist()
found = indent_many(
    Fingertip.load(FingertipConfig(mesh=MeshSpec(level="coarse"))),
    shapes,
    rng.uniform(-1.0, 1.0, POSES),
    force_gwt=rng.uniform(0.5, 4.0, POSES),
)
print(found)

table = found.table()
figure, axes = plt.subplots(layout="constrained")
for shape in np.unique(table["shape"]):
    rows = table["shape"] == shape
    print(f"{shape}: {np.nanmean(table['doi_mm'][rows]):.2f} mm deep on average")
    axes.plot(table["force_gwt"][rows], table["doi_mm"][rows], "o", label=shape)
axes.set(xlabel="force (gwt)", ylabel="depth of indentation (mm)")
axes.legend()
plt.show()
