"""Move a step across the finger at one force: highest pressure and regions of contact by position."""

import numpy as np

from sim import Fingertip, Indentations, indent_many


def main(finger: Fingertip, positions: int = 21, cores: int | None = None) -> Indentations:
    x_mm = np.linspace(2.0, -3.7, positions)
    found = indent_many(finger, "step:1", x_mm, force_gwt=2.33, cores=cores)

    table = found.table()
    for x, peak, regions, problem in zip(
        table["x_mm"], table["peak_pressure_pseudo"], table["regions"], table["problem"], strict=True
    ):
        print(f"x = {x:5.2f} mm: {problem or f'{peak:5.0f} pseudo-units, {regions} regions'}")
    return found


if __name__ == "__main__":  # processes import this file again
    main(Fingertip.load())
