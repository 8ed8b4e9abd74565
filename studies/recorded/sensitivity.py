"""How the example's verdict changes with what it assumes: the leading measure at each level of each axis.

    .venv/bin/python -m studies.recorded.sensitivity [AXIS…]

Writes rig/compare/data/bar3_sensitivity.csv, which the page of `rig compare --example bar3` shows, and
prints it. Nothing is tuned: every level is judged as the defaults are.
"""

import csv
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from io import StringIO
from pathlib import Path

import numpy as np

from rig.compare.example import (
    PHASES,
    SPEED_MM_S,
    PhaseVerdict,
    Rehearsal,
    judge_phase,
    recorded,
    rehearse,
    with_errors,
)
from rig.compare.example import positions as example_positions
from rig.compare.recordings.recording import Recording
from rig.data.folder import replace_text
from rig.plan.config import load_config
from sim.config import FingertipConfig, Tissue
from sim.measures.receptors import DEFAULT_DEPTH_MM
from sim.models.fingertip import Fingertip
from studies.registry import show

OUT = Path(__file__).parents[2] / "rig" / "compare" / "data" / "bar3_sensitivity.csv"
HEADER = ("axis", "level", "phase", "leads", "predicts", "second", "predicts second", "sed r")
DRAWS = 10
HUMAN = Path(__file__).parents[2] / "examples" / "human_finger" / "finger.toml"
ALLOWED = {
    "e_dermis": (0.054, 0.177),
    "e_fat": (0.053, 0.171),
}  # examples/plausible_fingers/allowed_by_the_source.toml

Row = tuple[str, ...]
Judged = dict[str, PhaseVerdict]


@dataclass(frozen=True)
class Level:
    """One level of an axis: what differs from the defaults."""

    axis: str
    level: str
    config: FingertipConfig = FingertipConfig()  # noqa: RUF009  (immutable)
    exact: bool = True
    depth_mm: float = DEFAULT_DEPTH_MM
    only_x_mm: float | None = None
    speed_mm_s: float = SPEED_MM_S


def tissue(**changed: float) -> FingertipConfig:
    """Return the default finger with other tissue."""
    return FingertipConfig(tissue=Tissue(**changed))


LEVELS = (
    Level("defaults", "–"),
    Level("ramp speed", "1 mm/s", speed_mm_s=1.0),
    Level("ramp speed", "100 mm/s", speed_mm_s=100.0),
    Level("receptor x", "−0.5 mm alone", only_x_mm=-0.5),
    Level("receptor x", "0 mm alone", only_x_mm=0.0),
    Level("receptor x", "0.5 mm alone", only_x_mm=0.5),
    Level("receptor depth", "0.6 mm", depth_mm=0.6),
    Level("receptor depth", "0.9 mm", depth_mm=0.9),
    Level("finite strain", "stiffening 0.3", tissue(stiffening=0.3)),
    Level("finite strain", "stiffening 0.8", tissue(stiffening=0.8)),
    Level("Poisson's ratio", "0.45", tissue(poisson=0.45)),
    Level("Poisson's ratio", "0.49", tissue(poisson=0.49)),
    Level("geometry", "epidermis 0.3 mm", tissue(epidermis_mm=0.3)),
    Level("geometry", "epidermis 0.5 mm", tissue(epidermis_mm=0.5)),
    *(
        Level("fingers the source allows", f"E dermis {d:g}, E fat {f:g}", tissue(e_dermis=d, e_fat=f), exact=False)
        for d, f in ((ALLOWED["e_dermis"][0], ALLOWED["e_fat"][1]), (ALLOWED["e_dermis"][1], ALLOWED["e_fat"][0]))
    ),
    Level("geometry", "human-sized finger", load_config(HUMAN).finger),
)


def rehearsal_of(level: Level) -> Rehearsal:
    """Return the rehearsal with one assumption changed."""
    finger = Fingertip.load(level.config, receptor_depth_mm=level.depth_mm, exact=level.exact)
    found = rehearse(finger.keeping_ways(), example_positions(), level.speed_mm_s)
    return found if level.only_x_mm is None else at_one_receptor(found, level.only_x_mm)


def at_one_receptor(rehearsal: Rehearsal, x_mm: float) -> Rehearsal:
    """Return the rehearsal with a single receptor, whose place is then not chosen by the recording."""
    stimulus = rehearsal.stimulus
    one = [int(np.argmin(np.abs(stimulus.receptor_mm - x_mm)))]
    assert stimulus.controls is not None
    only = replace(
        stimulus,
        receptor_mm=stimulus.receptor_mm[one],
        measures=stimulus.measures[..., one],
        controls=stimulus.controls[..., one],
    )
    return replace(rehearsal, stimulus=only, rates=rehearsal.rates[..., one])


def judged(rehearsal: Rehearsal, read: Callable[[Recording], Recording] = lambda one: one) -> Judged:
    """Return the verdict on each phase."""
    return {phase: judge_phase(rehearsal, read(recorded(phase)), phase) for phase in PHASES}


def row(axis: str, level: str, found: PhaseVerdict) -> Row:
    """Return one line of the table."""
    best = found.best
    second = next(one for one in found.rows if not one.control and one.name != best.name)
    numbers = f"{best.held_out:.3f}", f"{second.held_out:.3f}", f"{found.sed_r:.3f}"
    return axis, level, found.phase, best.title, numbers[0], second.title, numbers[1], numbers[2]


def draws(rehearsal: Rehearsal) -> Iterator[Row]:
    """Return what leads when the figure is read again with its errors, one line for each measure that leads."""
    rng = np.random.default_rng(2026)
    for phase in PHASES:
        found = [judge_phase(rehearsal, with_errors(recorded(phase), rng), phase) for _ in range(DRAWS)]
        counts = Counter(one.best.name for one in found)
        for name, count in counts.most_common():
            one = next(one for one in found if one.best.name == name)
            yield row("digitization, ± 0.05 mm, ± 3 /s", f"{count} of {DRAWS} draws", replace(one, phase=phase))


def main(axes: list[str]) -> None:
    """Measure every level, or those of some axes, and replace their rows in the table."""
    rows = [] if not (axes and OUT.is_file()) else _read()
    for level in LEVELS:
        if axes and level.axis not in axes:
            continue
        rehearsal = rehearsal_of(level)
        new = [row(level.axis, level.level, found) for found in judged(rehearsal).values()]
        new += draws(rehearsal) if level.axis == "defaults" else []
        rows = [one for one in rows if one[:3] not in {each[:3] for each in new}] + new
        _write(rows)
    show(HEADER, rows)


def _read() -> list[Row]:
    with OUT.open(encoding="utf-8", newline="") as lines:
        return [tuple(one) for one in csv.reader(lines)][1:]


def _write(rows: list[Row]) -> None:
    text = StringIO()
    csv.writer(text, lineterminator="\n").writerows([HEADER, *rows])
    replace_text(OUT, text.getvalue())


if __name__ == "__main__":
    main(sys.argv[1:])
