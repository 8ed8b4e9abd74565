"""How the verdicts of the shape test move with what the source leaves free, and with the force.

.venv/bin/python -m studies.source.verdicts_by_parameter    # a table of docs/validation/source_verdicts.md; minutes
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure as Canvas
from matplotlib.patches import Patch

from rig.compare.comparison import compare
from rig.compare.profile_shape_test import THRESHOLD
from rig.compare.raju_table_5_2 import agreement, agreement_limits, source_flags
from rig.report.page_parts import PageFigure, Section
from rig.report.style import BLUE, Plot, label
from rig.study.parallel import spread
from sim.config import FingertipConfig, Tissue
from sim.measures.measures import MEASURES
from sim.measures.receptors import DEFAULT_DEPTH_MM
from sim.models.fingertip import Fingertip
from studies.source.simulated_stimuli import bars, steps
from studies.source.table_agreement import LIMITS, with_limits

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


@dataclass(frozen=True)
class ParameterVerdicts:
    """What survives on one finger at one force."""

    variant: str
    force_gwt: float
    survivors: tuple[str, ...]  # of the steps
    candidates: tuple[str, ...]  # of steps and bars
    matthews: float
    limits: tuple[tuple[float, float], ...] = ()  # by measures, by receptors

    @property
    def row(self) -> tuple[str, ...]:
        """As cells."""
        names = (", ".join(found) or "none" for found in (self.survivors, self.candidates))
        score = with_limits(self.matthews, self.limits) if self.limits else f"{self.matthews:.2f}"
        return self.variant, f"{self.force_gwt:g}", *names, score


def verdicts(variant: str) -> list[ParameterVerdicts]:
    """One for each force."""
    tissue, depth_mm = VARIANTS[variant]
    finger = Fingertip.load(FingertipConfig(tissue=tissue), receptor_depth_mm=depth_mm)
    two, found = bars(finger), []
    for force_gwt in FORCES_GWT:
        three = steps(finger, force_gwt, POSITIONS_MM)
        judged = compare([*three, *two], {})
        ours = np.stack([flags for s in three if (flags := judged.passes(s)) is not None], axis=1)
        source = source_flags(three[0].receptor_mm)
        score = agreement(ours, source).matthews
        limits = tuple(agreement_limits(ours, source, over).matthews for over in ("measures", "receptors"))
        survivors, candidates = tuple(judged.candidates(stimuli=three)), tuple(judged.candidates())
        found.append(ParameterVerdicts(variant, force_gwt, survivors, candidates, score, limits))
    return found


def all_verdicts() -> Iterator[ParameterVerdicts]:
    """Every variant at every force, in order, over the processes of this machine."""
    for found in spread(verdicts, list(VARIANTS)):
        yield from found


HEADER = ("model", "force (gwt)", "survivors of the steps", "of steps and bars", "Matthews with Table 5.2")


def sensitivity_section(found: Sequence[ParameterVerdicts]) -> Section:
    """The table, and one picture of it."""
    return Section(
        "How the verdicts move with what is free",
        f"The shape test at {100 * THRESHOLD:g} % on other fingers, receptors and forces; steps at positions up to "
        f"0.1 mm beside the schedules', bars at DOI 1.0. {LIMITS}",
        HEADER,
        tuple(one.row for one in found),
        (
            PageFigure(
                "Survivors over receptor depth, epidermis, stiffness and force",
                Plot((7.6, 5.4), lambda canvas: _draw(canvas, found)),
                "Light: the measure survives steps 1, 3 and 5 at some receptor. Dark: both bars near x = 0, too. Two "
                "columns a finger: 2.33 and 8 gwt.",
            ),
        ),
    )


def _draw(canvas: Canvas, found: Sequence[ParameterVerdicts]) -> None:
    axes = canvas.subplots()
    level = np.array([[(m in one.survivors) + (m in one.candidates) for one in found] for m in MEASURES])
    shades = ListedColormap(["white", "#9ecae1", BLUE])
    axes.pcolormesh(level, cmap=shades, vmin=0, vmax=2, edgecolors="#dddddd", linewidth=0.5)
    axes.invert_yaxis()
    axes.set_yticks(np.arange(len(MEASURES)) + 0.5, [label(m) for m in MEASURES], fontsize=8)
    axes.set_xticks(np.arange(len(found)) + 0.5, [f"{one.force_gwt:g}" for one in found], fontsize=7)
    axes.set_xlabel("force (gwt)")
    for k, variant in enumerate(VARIANTS):
        middle = len(FORCES_GWT) * (k + 0.5)
        axes.annotate(variant, (middle, 0), (0, 4), textcoords="offset points", rotation=30, fontsize=8)
        axes.axvline(len(FORCES_GWT) * k, color="black", lw=0.8)
    keys = [Patch(fc="#9ecae1", label="survives the steps"), Patch(fc=BLUE, label="and the bars")]
    canvas.legend(handles=keys, loc="outside lower center", ncols=2, fontsize=8)


def main() -> None:
    """Print the table."""
    print(f"| {' | '.join(HEADER)} |\n|{'---|' * len(HEADER)}", flush=True)
    for one in all_verdicts():
        print(f"| {' | '.join(one.row)} |", flush=True)


if __name__ == "__main__":
    main()
