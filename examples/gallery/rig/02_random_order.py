"""
Forces in random order
======================

You get two blocks of the same three forces, each block in its own random order. The order depends only on the seed
and the number of the block, so a resumed run keeps it.

How-to: :doc:`/your_own_protocol`. Reference: :doc:`/data`.
"""

import json
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt

from rig.data import read_run
from rig.protocol import Rig, ScheduledParameters

Parameters = ScheduledParameters  # order, seed, blocks, repeats, rests


def run(rig: Rig) -> None:
    rig.mount("bar:3.0")
    rig.home()
    for block in rig.parameters.schedule((1.0, 2.0, 4.0)).on(rig):
        rig.move_to(x_mm=0.0)
        for force_gwt in block:
            rig.indent(force_gwt=force_gwt, hold_s=0.5)


if __name__ == "__main__":  # `rig` imports this file as a protocol
    with TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "rig", "dry-run", sys.argv[0], "order=random", "seed=4", "blocks=2"]
        done = subprocess.run([*command, "--out", folder, "--json"], check=True, capture_output=True, text=True)
        recorded = read_run(Path(json.loads(done.stdout)["run"]))
    figure, axes = plt.subplots(layout="constrained")
    for press in recorded.stream("indentation_start"):
        samples = [one for one in recorded.stream("sample") if one["index"] == press["index"]]
        axes.plot([one["t_s"] for one in samples], [one["force_gwt"] for one in samples], color=f"C{press['block']}")
    axes.set(xlabel="time, one color for each block (s)", ylabel="force (gwt)")
    plt.show()
