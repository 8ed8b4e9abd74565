"""An indentor of your own, from arrays: a shallow dome with a ripple, carried along the finger."""

import numpy as np

from sim import Fingertip, IndentationResult, MeasuredProfile


def main(finger: Fingertip) -> IndentationResult:
    x_mm = np.linspace(-2.0, 2.0, 81)  # rising; 0 is the place that x_mm of a press names
    height_mm = 0.1 * x_mm**2 + 0.02 * np.cos(8 * x_mm)  # above any level
    dome = MeasuredProfile.from_arrays(x_mm, height_mm, name="rippled dome")

    result = finger.indent(dome, x_mm=0.1, force_gwt=2.0)
    print(f"{dome}: {result.doi_mm:.3f} mm deep, {len(result.contact_regions_mm)} regions")
    return result


if __name__ == "__main__":
    main(Fingertip.load())
