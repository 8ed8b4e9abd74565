"""Strain where you want it: receptors at any places across the receptor plane, at any depth below the skin.

A model holds the strain at its receptors only: each depth is a model of its own, built once (seconds) and cached.
"""

import numpy as np
from numpy.typing import NDArray

from sim import Fingertip, FingertipConfig


def main(config: FingertipConfig, depths_mm: tuple[float, ...] = (0.5, 0.76, 1.0)) -> NDArray[np.float64]:
    x_mm = np.linspace(-2.0, 2.0, 17)
    sed = []
    for depth_mm in depths_mm:
        finger = Fingertip.load(config, receptor_x_mm=x_mm.tolist(), receptor_depth_mm=depth_mm)
        sed.append(finger.indent("cylinder:3", doi_mm=0.3).receptor_measures["sed"])
        print(f"{depth_mm:.2f} mm deep: highest SED {sed[-1].max():.3g} at x = {x_mm[sed[-1].argmax()]:g} mm")
    return np.array(sed)  # (depths, x)


if __name__ == "__main__":
    main(FingertipConfig())
