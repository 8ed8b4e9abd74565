"""How the example's verdict changes with what it assumes: the leading measure at each level of each axis.

    .venv/bin/python -m studies.recorded.sensitivity [AXIS…]

Writes rig/compare/data/bar3_sensitivity.csv, which the page of `rig compare --example bar3` shows, and
prints it. Nothing is tuned: every level is judged as the defaults are.
"""

import csv
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from io import StringIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.compare.example import (
    DOI_MM,
    PHASES,
    SHAPE,
    SPEED_MM_S,
    PhaseVerdict,
    Rehearsal,
    judge_phase,
    ramps,
    recorded,
    rehearsal_of,
    rehearse,
    with_errors,
)
from rig.compare.example import positions as example_positions
from rig.data.folder import replace_text
from rig.plan.config import load_config
from sim.config import FingertipConfig, MeshSpec, Tissue
from sim.measures.receptors import DEFAULT_DEPTH_MM
from sim.models.fingertip import Fingertip
from sim.models.friction import Order, press_profile
from sim.models.sources import widened
from studies.registry import show

OUT = Path(__file__).parents[2] / "rig" / "compare" / "data" / "bar3_sensitivity.csv"
HEADER = ("axis", "level", "phase", "leads", "predicts", "second", "predicts second", "sed r")
DRAWS = 10
DIGITIZATION = "digitization, ± 0.05 mm, ± 3 /s"
HUMAN = Path(__file__).parents[2] / "examples" / "human_finger" / "finger.toml"
ALLOWED = {
    "e_dermis": (0.054, 0.177),
    "e_fat": (0.053, 0.171),
}  # examples/plausible_fingers/allowed_by_the_source.toml

RUBBED = "friction on a coarse mesh"
COARSE = FingertipConfig(mesh=MeshSpec(level="coarse"))
ORDERS: dict[Order, str] = {
    "lifted": "lifted between presses",
    "ascending": "slid to larger x",
    "descending": "slid to smaller x",
}

Array = NDArray[np.float64]
Row = tuple[str, ...]


@dataclass(frozen=True)
class Level:
    """One level of an axis: what differs from the defaults."""

    axis: str
    level: str
    config: FingertipConfig = FingertipConfig()  # noqa: RUF009  (immutable)
    depth_mm: float = DEFAULT_DEPTH_MM
    only_x_mm: float | None = None
    speed_mm_s: float = SPEED_MM_S
    friction: float | None = None
    order: Order = "lifted"

    @property
    def phases(self) -> tuple[str, ...]:
        """Phases that are judged: a bar that slides from position to position has no ramp."""
        return PHASES if self.order == "lifted" else PHASES[:1]


def tissue(**changed: float) -> FingertipConfig:
    """Return the default finger with other tissue."""
    return FingertipConfig(tissue=Tissue.model_validate(changed))


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
        Level("fingers the source allows", f"E dermis {d:g}, E fat {f:g}", tissue(e_dermis=d, e_fat=f))
        for d, f in ((ALLOWED["e_dermis"][0], ALLOWED["e_fat"][1]), (ALLOWED["e_dermis"][1], ALLOWED["e_fat"][0]))
    ),
    Level("geometry", "human-sized finger", load_config(HUMAN).finger),
    Level(RUBBED, "0", COARSE, friction=0.0),
    *(
        Level(RUBBED, f"{friction:g}, {how}", COARSE, friction=friction, order=order)
        for order, how in ORDERS.items()
        for friction in (0.3, 0.6)
    ),
)


def rehearsed(level: Level) -> tuple[Rehearsal, str]:
    """Return the rehearsal with one assumption changed, and what its label says of presses without convergence."""
    finger = Fingertip.load(level.config, receptor_depth_mm=level.depth_mm)
    found = rehearse(finger.keeping_ways(), example_positions(), level.speed_mm_s)
    if level.friction is not None:
        return rubbed(level, finger, found.stimulus.x_mm)
    return found if level.only_x_mm is None else at_one_receptor(found, level.only_x_mm), ""


def rubbed(level: Level, finger: Fingertip, x_mm: Array) -> tuple[Rehearsal, str]:
    """Return the rehearsal with friction, on the largest patch that a press without friction needs.

    One patch for all positions, so that each step of a ramp continues from the step before.
    """
    ends = [finger.indent(SHAPE, float(x), doi_mm=DOI_MM).model.widened_mm for x in x_mm[[0, -1]]]
    patch = max((one for one in ends if one is not None), default=None)
    rubbing = Fingertip.load(widened(level.config, patch), receptor_depth_mm=level.depth_mm)
    assert level.friction is not None
    if level.order == "lifted":
        paths = ramps(rubbing.with_friction(level.friction), x_mm)
    else:
        pressed = press_profile(
            rubbing, SHAPE, x_mm.tolist(), doi_mm=DOI_MM, friction=level.friction, order=level.order
        )
        paths = [[one] for one in pressed]
    missed = sum(not all(step.state.converged for step in path) for path in paths)
    note = f" ({missed} of {len(paths)} presses did not converge)" if missed else ""
    return rehearsal_of(rubbing, paths, level.speed_mm_s), note


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
            yield row(DIGITIZATION, f"{count} of {DRAWS} draws", replace(one, phase=phase))


def main(axes: list[str]) -> None:
    """Measure every level, or those of some axes, and replace their rows in the table."""
    rows = [] if not (axes and OUT.is_file()) else _read()
    for level in LEVELS:
        if axes and level.axis not in axes:
            continue
        rehearsal, note = rehearsed(level)
        verdicts = [judge_phase(rehearsal, recorded(phase), phase) for phase in level.phases]
        new = [row(level.axis, level.level + note, found) for found in verdicts]
        new += draws(rehearsal) if level.axis == "defaults" else []
        rows = [one for one in rows if not replaced(one, level)] + new
        _write(rows)
    show(HEADER, rows)


def replaced(stored: Row, level: Level) -> bool:
    """Return whether a level that is measured again replaces a stored row."""
    again = stored[0] == level.axis and stored[1].partition(" (")[0] == level.level
    return again or (level.axis == "defaults" and stored[0] == DIGITIZATION)


def _read() -> list[Row]:
    with OUT.open(encoding="utf-8", newline="") as lines:
        return [tuple(one) for one in csv.reader(lines)][1:]


def _write(rows: list[Row]) -> None:
    text = StringIO()
    csv.writer(text, lineterminator="\n").writerows([HEADER, *rows])
    replace_text(OUT, text.getvalue())


if __name__ == "__main__":
    main(sys.argv[1:])
