"""How far SSRPs interpolated between the fingers of a design are from those of fingers simulated directly.

.venv/bin/python -m studies.accuracy.finger_interpolation    # docs/validation/comparison.md has the table; minutes

The fingers are those of studies/answers/answer_coverage.py, drawn within the ranges of
examples/plausible_fingers/fingers.toml.
"""

import numpy as np
from numpy.typing import NDArray

from rig.compare.plausible_fingers import free_of, read_plausible, weights
from rig.compare.stimuli import Stimulus
from rig.compare.workers import spread
from sim.config import FingertipConfig
from sim.measures.measures import MEASURES
from sim.measures.receptors import DEFAULT_DEPTH_MM
from studies.answers.answer_coverage import POSITIONS_MM, RANGES, TRUTHS, drawn, families, inside, with_design

Array = NDArray[np.float64]

HEADER = ("family", "measure", "interpolated, mean / worst (%)", "the default finger instead, mean / worst (%)")


def error(found: Array, direct: Array) -> float:
    """Rms over positions (p,) in percent of the range there."""
    return 100 * float(np.sqrt(np.nanmean((found - direct) ** 2)) / (np.nanmax(direct) - np.nanmin(direct)))


def row(family: str, truth: tuple[str, float], fitted: list[Stimulus], others: list[list[Stimulus]]) -> str:
    """A measure at a receptor: how far off the interpolated SSRPs are, and those of the default finger."""
    measure, x_mm = truth
    m, receptor = MEASURES.index(measure), int(np.argmin(np.abs(fitted[0].receptor_mm - x_mm)))
    both = []
    for share, one in zip(weights(drawn(free_of(fitted[0].on_fingers_at(POSITIONS_MM)))), others, strict=True):
        for mine, theirs in zip(fitted, one, strict=True):
            direct = theirs.at(POSITIONS_MM)[m, :, receptor]
            there = share @ mine.on_fingers_at(POSITIONS_MM)[:, m, :, receptor]
            both.append((error(there, direct), error(mine.at(POSITIONS_MM)[m, :, receptor], direct)))
    pairs = zip(np.mean(both, axis=0), np.max(both, axis=0), strict=True)
    cells = [f"{mean:.1f} / {worst:.1f}" for mean, worst in pairs]
    return f"| {family} | {measure} at {x_mm:g} | {' | '.join(cells)} |"


def main() -> None:
    """Print the table."""
    plausible = read_plausible(RANGES)
    design = [one.config for one in plausible.design(FingertipConfig(), DEFAULT_DEPTH_MM)]
    default, *simulated = spread(families, [FingertipConfig(), *design, *inside(plausible)])
    fitted, others = with_design(default, simulated[: len(design)]), simulated[len(design) :]
    print(f"| {' | '.join(HEADER)} |\n|{'---|' * len(HEADER)}")
    for family in ("steps", "bars"):
        for truth in TRUTHS[family]:
            print(row(family, truth, fitted[family], [one[family] for one in others]), flush=True)


if __name__ == "__main__":
    main()
