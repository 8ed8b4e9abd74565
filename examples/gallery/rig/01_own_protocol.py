"""
A protocol of your own
======================

You get the force during a rehearsal of your own protocol: a bar at three places, pressed in three increments each.
The script is the protocol; ``rig run FILE --config rig.toml`` runs the same file on a rig.

How-to: :doc:`/your_own_protocol`. Reference: :doc:`/python_names`.
"""

import json
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt

from rig.data import read_run
from rig.protocol import Rig


def run(rig: Rig) -> None:
    rig.mount("bar:3.0")
    rig.home()
    rig.zero()
    for x_mm in (-0.5, 0.0, 0.5):
        rig.move_to(x_mm=x_mm)
        rig.indent(doi_mm=0.6, increments=3, hold_s=0.5)


if __name__ == "__main__":  # `rig` imports this file as a protocol
    with TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "rig", "dry-run", sys.argv[0], "--out", folder, "--json"]
        done = subprocess.run(command, check=True, capture_output=True, text=True)
        samples = read_run(Path(json.loads(done.stdout)["run"])).stream("sample")
    figure, axes = plt.subplots(layout="constrained")
    axes.plot([one["t_s"] for one in samples], [one["force_gwt"] for one in samples])
    axes.set(xlabel="time (s)", ylabel="force (gwt)")
    plt.show()
