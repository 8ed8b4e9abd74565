"""How the verdicts of the shape test move with what the source leaves free, and with the force.

.venv/bin/python bench/sensitivity.py      # the table of docs/comparison.md, about ten minutes
"""

import numpy as np

from rig.compare.comparison import compare
from rig.compare.table_5_2 import agreement, source_flags
from sim.config import FingertipConfig, Tissue
from sim.fingertip import Fingertip
from sim.measures.receptors import DEFAULT_DEPTH_MM
from simulated import bars, steps

# As close as the source's schedules, up to 0.1 mm beside them; one row of positions for all three steps.
POSITIONS_MM = np.array(
    [-5.7, -5.2, -4.7, -4.2, -3.69, -3.25, -2.75, -2.25, *np.arange(-1.97, 0.2, 0.17), 0.5, 1, 1.5, 2]
)
FORCES_GWT = (2.33, 8.0)

_TISSUE = Tissue()
VARIANTS: dict[str, tuple[Tissue, float]] = {
    "default": (_TISSUE, DEFAULT_DEPTH_MM),
    "receptors at 0.60 mm": (_TISSUE, 0.60),
    "receptors at 0.90 mm": (_TISSUE, 0.90),
    "epidermis − 25 %": (Tissue(epidermis_mm=0.75 * _TISSUE.epidermis_mm), DEFAULT_DEPTH_MM),
    "epidermis + 25 %": (Tissue(epidermis_mm=1.25 * _TISSUE.epidermis_mm), DEFAULT_DEPTH_MM),
    "dermis and fat half as stiff": (Tissue(e_dermis=0.05, e_fat=0.05), DEFAULT_DEPTH_MM),
    "dermis and fat twice as stiff": (Tissue(e_dermis=0.2, e_fat=0.2), DEFAULT_DEPTH_MM),
}


def row(name: str, finger: Fingertip, force_gwt: float) -> str:
    """One line of the table."""
    three, two = steps(finger, force_gwt, POSITIONS_MM), bars(finger)
    found = compare([*three, *two], {})
    ours = np.stack([flags for s in three if (flags := found.passes(s)) is not None], axis=1)
    score = agreement(ours, source_flags(three[0].receptor_mm))
    survivors, candidates = found.candidates(stimuli=three), found.candidates()
    return f"| {name} | {force_gwt:g} | {', '.join(survivors)} | {', '.join(candidates)} | {score.matthews:.2f} |"


def main() -> None:
    """Print the table."""
    print("| model | force (gwt) | survivors of the steps | of steps and bars | Matthews with Table 5.2 |")
    print("|---|---|---|---|---|", flush=True)
    for name, (tissue, depth_mm) in VARIANTS.items():
        finger = Fingertip.load(FingertipConfig(tissue=tissue), receptor_depth_mm=depth_mm)
        for force_gwt in FORCES_GWT:
            print(row(name, finger, force_gwt), flush=True)


if __name__ == "__main__":
    main()
