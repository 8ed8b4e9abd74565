"""
A recorded afferent under a bar
===============================

You get the page of `rig compare --example bar3` and its figure: discharge rates of one SA-I afferent under a 3 mm bar
(Phillips and Johnson 1981), and the rates that the best measures on the simulated finger predict.

How-to: :doc:`/comparison`. What comes out: :doc:`/validation/comparison`.
"""

import json
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt

from rig.compare.example import recorded

with TemporaryDirectory() as folder:
    command = [sys.executable, "-m", "rig", "compare", "--example", "bar3", "--out", str(Path(folder, "bar3.html"))]
    done = subprocess.run([*command, "--json"], check=True, capture_output=True, text=True)
phases = json.loads(done.stdout)["phases"]
best = {one["phase"]: one["rows"][0] for one in phases}

figure, panels = plt.subplots(1, 2, figsize=(8, 3), layout="constrained")
for axes, one in zip(panels, phases, strict=True):
    recording, row = recorded(one["phase"]), best[one["phase"]]
    axes.plot(recording.position_mm, recording.rate, "ko", ms=3)
    axes.set_title(f"{one['phase']}: {row['candidate']}, {row['held_out']:.0%} of held-out deviance", fontsize=8)
    axes.set(xlabel="position (mm)", ylabel="discharge rate (impulses/s)")
plt.show()
