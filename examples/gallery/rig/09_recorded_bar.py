"""
A recorded afferent under a bar
===============================

You get the page of `rig compare --example bar3` and its figure: discharge rates of one SA-I afferent under a 3 mm bar
(Phillips and Johnson 1981), and the rates that the best measures on the simulated finger predict.

.. image:: /figures/bar3.png
   :alt: Recorded and predicted rates under a 3 mm bar

How-to: :doc:`/comparison`. What comes out: :doc:`/validation/comparison`.
"""

import json
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt

from rig.report.example_page import plot_example

# sphinx_gallery_thumbnail_path = "figures/bar3.png"

with TemporaryDirectory() as folder:
    command = [sys.executable, "-m", "rig", "compare", "--example", "bar3", "--out", str(Path(folder, "bar3.html"))]
    done = subprocess.run([*command, "--json"], check=True, capture_output=True, text=True)
phases = json.loads(done.stdout)["phases"]

figure = plt.figure(figsize=(8, 3.3), layout="constrained")
plot_example(figure)  # from the cache that the command above has filled
plt.show()
