"""Time that presses take, from a rehearsal of a few of them on springs, and the designs that fit into a session."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.design.exceptions import DesignError
from rig.design.presses import PossiblePress
from rig.design.response_table import ResponseTable
from rig.errors import BadInputError
from rig.plan.config import Config
from rig.plan.finger_model import FingerModel
from rig.plan.plan import Plan, Planner, make_plan
from rig.protocol.api import ProtocolParameters, Rig
from rig.protocol.check import ScriptState
from rig.protocol.script import Script
from rig.records import PlannedIndentation
from rig.session.rehearse import rehearsed
from sim.finger_process import Finger

Array = NDArray[np.float64]

_REHEARSED = 5  # of each of two shapes


class PressTimes(NamedTuple):
    """Time before the first press and after the last, of each press with its move and rest, and of a change (s)."""

    first_s: float
    press_s: Array  # (presses,)
    change_s: float

    def session_s(self, order: Sequence[int], shapes: int) -> float:
        """Return the time of presses in blocks, one block per shape (s)."""
        return self.first_s + max(shapes - 1, 0) * self.change_s + float(self.press_s[list(order)].sum())


def press_times(
    config: Config, finger: Finger, table: ResponseTable, hold_s: float, rest_s: float, change_s: float
) -> PressTimes:
    """Return the times, linear in the depth of each press, from a rehearsal of presses of one or two shapes.

    The motion around a change of indentor is added to the time that the operator needs.
    """
    presses, doi_mm = table.presses, table.doi_mm
    shapes = list(dict.fromkeys(press.shape for press in presses))[:2]
    blocks = [_some([k for k, press in enumerate(presses) if press.shape == shape]) for shape in shapes]

    def run(rig: Rig) -> None:
        for number, block in enumerate(blocks):
            rig.mount(presses[block[0]].shape)
            if not number:
                rig.home()
            rig.zero()
            for k in block:
                presses[k].make(rig, hold_s)
                rig.rest(rest_s)

    script = in_memory(run)
    rehearsal = rehearsed(script, config, finger, make_plan(script, config, finger, known=table.predictions))
    rested_s = np.array(sorted(at for name, at in rehearsal.course.instants_s.items() if name[0] == "rest"))
    made = np.concatenate(blocks)
    between = np.diff(rested_s)
    within = np.ones(len(between), dtype=bool)
    within[len(blocks[0]) - 1 : len(blocks[0])] = False
    depth, took_s = doi_mm[made[1:]][within], between[within]
    slope, at_zero = np.polyfit(depth, took_s, 1) if np.ptp(depth) > 0 else (0.0, took_s.mean())
    press_s = np.maximum(at_zero + slope * doi_mm, 1.0)
    around_s = float((between[~within] - press_s[made[1:]][~within]).sum())
    first_s = float(rehearsal.duration_s - rested_s[-1] + rested_s[0] - press_s[made[0]])
    return PressTimes(first_s, press_s, change_s + max(around_s, 0.0))


def _some(mine: Sequence[int]) -> list[int]:
    """Return a few of the presses, with moves as far apart as in a design."""
    some = [mine[k] for k in np.unique(np.linspace(0, len(mine) - 1, _REHEARSED).round().astype(int))]
    return [some[k] for k in np.random.default_rng(0).permutation(len(some))]


def in_memory(run: Callable[[Rig], None]) -> Script:
    """Return a function as a script without a file."""
    return Script(Path(__file__), "design", "Designed presses", "docs/design.md", ProtocolParameters(), run)


def planned_alone(
    config: Config, model: FingerModel, presses: Iterable[PossiblePress], hold_s: float
) -> Iterator[PlannedIndentation | BadInputError]:
    """Yield the plan of each press as if it were the only one, since a session makes few of them, or its refusal."""
    plan, state = Plan(), ScriptState(config, model)
    rig, shape = Rig(ProtocolParameters(), state, Planner(state, plan)), ""
    for press in presses:
        if press.shape != shape:
            rig.mount(press.shape)
            rig.home()
            rig.zero()
            shape = press.shape
        state.held_s = 0.0
        try:
            press.make(rig, hold_s)
        except BadInputError as error:
            yield error
        else:
            yield plan.indentations[-1]


def allowed(
    config: Config, finger: Finger, table: ResponseTable, hold_s: float, progress: Callable[[int, int], None]
) -> ResponseTable:
    """Return the table of the presses that the planner accepts within the limits.

    Raises DesignError if there are none.
    """
    model = FingerModel(finger, table.predictions, str, config.identified)
    unsolved = np.isnan(table.values).any(axis=(0, 2, 3)) | np.isnan(table.about).any(axis=1)
    solved = np.flatnonzero(np.logical_not(unsolved)).tolist()
    kept: list[int] = []
    first: BadInputError | None = None
    for k, found in zip(
        solved, planned_alone(config, model, (table.presses[k] for k in solved), hold_s), strict=True
    ):
        progress(k, len(table.presses))
        if isinstance(found, BadInputError):
            first = first or found
        else:
            kept.append(k)
    if not kept:
        problem = "the finger model solves none of them" if first is None else str(first)
        raise DesignError(
            f"no press of {len(table.presses)} is within the limits: {problem}", "all_refused"
        ) from None
    return table.only(kept)
