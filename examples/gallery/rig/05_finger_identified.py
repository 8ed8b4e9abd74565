"""
A finger identified
===================

You get the force of each identification press beside the band that was predicted just before it. The finger is
virtual: softer than the default one, and it stiffens and relaxes as fingers do.

How-to: :doc:`/identify`.
"""

import json
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt
import numpy as np

from rig.data import read_run

REHEARSAL = """
[finger.tissue]
stiffness = 0.7
stiffening = 0.3

[virtual]
relaxation = [[0.2, 0.07], [0.2, 1.4]]
"""
with TemporaryDirectory() as folder:
    Path(folder, "rehearsal.toml").write_text(REHEARSAL, encoding="utf-8")
    options = ["--dry-run", "--config", "rehearsal.toml", "--to", "finger.toml", "--yes", "--json"]
    options += ["--shapes", "bar:3.0"]  # the indentor that is on the bench
    command = [sys.executable, "-m", "rig", "identify", *options]
    done = subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True)
    notes = read_run(Path(folder, json.loads(done.stdout)["run"])).stream("note")

presses = [json.loads(note["text"]) for note in notes if note["text"].startswith("{")]
low, middle, high = np.array([press["predicted_gwt"] for press in presses]).T
numbers = [press["press"] for press in presses]
figure, axes = plt.subplots(layout="constrained")
axes.errorbar(numbers, middle, [middle - low, high - middle], fmt="s", capsize=4, label="predicted, 90 % band")
axes.plot(numbers, [press["measured_gwt"] for press in presses], "k_", ms=20, label="measured")
axes.set(xlabel="press (1)", ylabel="force (gwt)", xticks=numbers, yscale="log")
axes.legend()
plt.show()
