"""Strain where you want it: press once, then ask at any points inside; here a sheet of them across the finger."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sim import Fingertip


def main(finger: Fingertip, depths_mm: Sequence[float] = (0.1, 0.3, 0.5, 0.76, 1.0, 2.0)) -> NDArray[np.float64]:
    result = finger.indent("cylinder:3", doi_mm=0.3)

    x_mm = np.linspace(-2.0, 2.0, 17)
    sheet = finger.points_below(x_mm, np.array(depths_mm)[:, None])  # (depths, x, 3); any (…, 3) will do
    fields = finger.fields(result, sheet)  # .strain (depths, x, 6), .stress likewise, .measures, .table()

    sed = fields.measures["sed"]  # (depths, x)
    for depth_mm, row in zip(depths_mm, sed, strict=True):
        print(f"{depth_mm:.2f} mm deep: highest SED {row.max():.3g} at x = {x_mm[row.argmax()]:g} mm")
    return sed


if __name__ == "__main__":
    main(Fingertip.load())
