"""
A letter pressed
================

You get the contact of an embossed letter with the finger, beside the picture that the letter comes from. Dark pixels
are raised; the picture is 3 mm wide, the letter 0.5 mm high.

How-to: :doc:`/shapes`. Reference: :doc:`/commands`.
"""

import json
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt

with TemporaryDirectory() as folder:
    letter, contact = Path(folder, "R.png"), Path(folder, "contact.png")
    plt.figure(figsize=(2, 2), dpi=50)
    plt.figtext(0.5, 0.5, "R", size=150, ha="center", va="center_baseline")
    plt.savefig(letter)
    plt.close()

    Path(folder, "coarse.toml").write_text('finger.mesh.level = "coarse"\n', encoding="utf-8")
    shape = "heightmap:R.png,width_mm=3,height_mm=0.5"
    command = [sys.executable, "-m", "rig", "indent", "--shape", shape, "--x-mm", "0", "--doi-mm", "0.3"]
    command += ["--config", "coarse.toml", "--picture", "contact.png", "--json"]
    done = subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True)
    answer = json.loads(done.stdout)
    print(f"{answer['force_gwt']:.2f} gwt at {answer['doi_mm']:.2f} mm")

    figure, (left, right) = plt.subplots(1, 2, width_ratios=(1, 2), layout="constrained")
    for axes, picture in ((left, letter), (right, contact)):
        axes.imshow(plt.imread(picture))
        axes.set_axis_off()
    plt.show()
