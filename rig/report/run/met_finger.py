"""The section of a run's report on a finger that was met: what was promised, what was found, what was learned."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rig.data import Run
from rig.data.folder import replace_text
from rig.plan.config import load_config
from rig.plan.met.finger_file import TISSUE, Draw
from rig.plan.met.learned import learned
from rig.plan.met.promises import Found, found
from sim.models.fingertip import Fingertip

AFTER = "finger_after.toml"
Row = tuple[str, str, str]


@dataclass(frozen=True)
class MetFinger:
    """Promises beside what was found, and parameters before and after."""

    sentence: str
    found: list[Found]
    learned: list[Row]


def met_finger(run: Run, finger: Fingertip) -> MetFinger | None:
    """None for a finger that nobody met. Writes its file anew where reference presses say something of it."""
    pairs = found(run)
    if not pairs:
        return None
    met = load_config(run.folder.config).met
    assert met is not None
    after = learned(run, finger)
    if after is not None:
        replace_text(run.folder.path / AFTER, after.as_toml())
    inside = sum(one.kept for one in pairs)
    sentence = (
        f"Met on {met.date} in {met.presses} presses. Of {len(pairs)} presses here {inside} lie in their band, "
        f"which is to hold {met.band.coverage:.0%}."
    )
    return MetFinger(sentence, pairs, [] if after is None else _rows(met.draw, after.met.draw))


def _rows(before: Sequence[Draw], after: Sequence[Draw]) -> list[Row]:
    return [(name, _told(before, name), _told(after, name)) for name in TISSUE]


def _told(draws: Sequence[Draw], name: str) -> str:
    values = np.array([getattr(draw, name) for draw in draws])
    return f"{values.mean():.3g} ± {values.std(ddof=1):.2g}"
