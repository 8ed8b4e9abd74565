"""
A parameter study on a cluster
==============================

You get force against depth for three thicknesses of the epidermis, computed by the workers of a dask cluster. The
cluster here has two workers on this machine; for others, pass the address of their scheduler.

How-to: :doc:`/parameter_studies`. Reference: :doc:`/configuration`.
"""

import csv
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt
from distributed import LocalCluster

STUDY = """
receptor_x_mm = [0.0]
finger.tissue.epidermis_mm = [0.3, 0.4, 0.5]
finger.mesh = {spacing_mm = 0.4, axial_spacing_mm = 0.6}
press = [{shape = "cylinder:9", doi_mm = [0.1, 0.2, 0.3, 0.4]}]
"""
with (
    TemporaryDirectory() as folder,
    LocalCluster(
        n_workers=2, threads_per_worker=1, processes=False, protocol="tcp://", dashboard_address=None
    ) as cluster,
):
    study, table = Path(folder, "study.toml"), Path(folder, "study.csv")
    study.write_text(STUDY, encoding="utf-8")
    words = ["study", str(study), "--out", str(table), "--scheduler", cluster.scheduler_address]
    subprocess.run([sys.executable, "-m", "rig", *words], check=True, capture_output=True)
    rows = list(csv.DictReader(table.read_text(encoding="utf-8").splitlines()))

figure, axes = plt.subplots(layout="constrained")
for thickness in sorted({row["tissue.epidermis_mm"] for row in rows}):
    mine = [row for row in rows if row["tissue.epidermis_mm"] == thickness]
    axes.plot([float(row["value"]) for row in mine], [float(row["force_gwt"]) for row in mine], "o-", label=thickness)
axes.set(xlabel="depth of indentation (mm)", ylabel="force (gwt)")
axes.legend(title="epidermis (mm)")
plt.show()
