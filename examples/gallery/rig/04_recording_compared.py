"""
A recording compared
====================

You get the correlation of each stress or strain measure at each receptor with recorded spike counts. The recording is
synthetic: it belongs to an afferent that responds to ep1 at one place. The script needs a clone of the project.

How-to: :doc:`/comparison`. Explanation: :doc:`/statistics`.
"""

import json
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt
import numpy as np

TUTORIAL = Path(sys.argv[0]).resolve().parents[2] / "tutorial"
with TemporaryDirectory() as folder:
    command = [sys.executable, "-m", "rig", "dry-run", str(TUTORIAL / "first.py"), "--out", folder, "--json"]
    run = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)["run"]
    recorded = f"step:1={TUTORIAL / 'synthetic_afferent.csv'}"
    command = [sys.executable, "-m", "rig", "compare", run, "--recorded", recorded, "--json"]
    compared = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)

measures = list(dict.fromkeys(row["measure"] for row in compared["rows"]))
receptors_mm = sorted({row["receptor_mm"] for row in compared["rows"]})
r = np.full((len(measures), len(receptors_mm)), np.nan)
for row in [row for row in compared["rows"] if row["positions"] > 5]:  # r of a few positions means nothing
    r[measures.index(row["measure"]), receptors_mm.index(row["receptor_mm"])] = row["r"]

figure, axes = plt.subplots(layout="constrained")
shown = axes.imshow(r, vmin=-1, vmax=1, cmap="RdBu_r", aspect="auto")
axes.set_xticks(range(len(receptors_mm)), [f"{x:.2f}" for x in receptors_mm])
axes.set_yticks(range(len(measures)), measures)
axes.set(xlabel="receptor at x (mm)", title="Fit to a synthetic afferent")
figure.colorbar(shown, label="correlation r")
plt.show()
