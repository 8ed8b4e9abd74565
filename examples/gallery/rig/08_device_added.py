"""
A device added
==============

You get a rehearsal with a force sensor that a package of your own adds: a scale with a line protocol. Its driver is
tested against its virtual twin, byte by byte. The script needs a clone of the project.

How-to: :doc:`/adding_a_device`. Reference: :doc:`/devices`.
"""

import json
import os
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt

from rig.data import read_run

PACKAGE = Path(sys.argv[0]).resolve().parents[2] / "rig_line_scale"
CONFIG = '[force]\nkind = "line_scale"\n\n[force.line_scale]\naddress = 7\n'
with TemporaryDirectory() as folder:
    Path(folder, "rig.toml").write_text(CONFIG, encoding="utf-8")
    info = Path(folder, "rig_line_scale-1.0.dist-info")  # `pip install` of the package leaves these two files
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: rig-line-scale\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[rig.devices]\nforce.line_scale = rig_line_scale.entry:DEVICE\n")
    place = {**os.environ, "PYTHONPATH": os.pathsep.join([folder, str(PACKAGE)])}
    command = [sys.executable, "-m", "rig", "dry-run", "bars", "from_mm=0.4", "to_mm=-0.4", "spacing_mm=0.4"]
    options = ["--config", str(Path(folder, "rig.toml")), "--out", folder, "--json"]
    done = subprocess.run([*command, *options], env=place, check=True, capture_output=True, text=True)
    samples = read_run(Path(json.loads(done.stdout)["run"])).stream("sample")

figure, axes = plt.subplots(layout="constrained")
axes.plot([one["t_s"] for one in samples], [one["force_gwt"] for one in samples])
axes.set(xlabel="time (s)", ylabel="force on the line scale (gwt)")
plt.show()
