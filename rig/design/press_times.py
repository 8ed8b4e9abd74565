"""Time that presses take, from a rehearsal of a few of them on springs, and the designs that fit into a session."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.data.run_state import Milestone
from rig.design.exceptions import DesignError
from rig.design.presses import PossiblePress
from rig.design.response_table import ResponseTable
from rig.errors import BadInputError
from rig.plan.config import Config
from rig.plan.finger_model import FingerModel
from rig.plan.plan import Plan, Planner, make_plan
from rig.protocol.api import ProtocolParameters, Rig
from rig.protocol.check import Walk
from rig.protocol.script import Script
from rig.session.rehearse import rehearsed
from sim.finger_process import Finger

Array = NDArray[np.float64]

_REHEARSED = 12


class PressTimes(NamedTuple):
    """Time before the first press, of each press with its move and rest, and of a change of indentor (s)."""

    first_s: float
    press_s: Array  # (presses,)
    change_s: float

    def session_s(self, order: Sequence[int], shapes: int) -> float:
        """Return the time of presses in blocks, one for each of so many shapes."""
        return self.first_s + max(shapes - 1, 0) * self.change_s + float(self.press_s[list(order)].sum())


def press_times(
    config: Config,
    finger: Finger,
    presses: Sequence[PossiblePress],
    doi_mm: Array,
    hold_s: float,
    rest_s: float,
    change_s: float,
) -> PressTimes:
    """Return the times, linear in the depth (mm) of each press; fitted to a rehearsal of presses of one shape."""
    shape = presses[0].shape
    mine = [k for k, press in enumerate(presses) if press.shape == shape]
    some = [mine[k] for k in np.unique(np.linspace(0, len(mine) - 1, _REHEARSED).round().astype(int))]
    chance = np.random.default_rng(0)
    some = [some[k] for k in chance.permutation(len(some))]  # moves as far apart as in a design

    def run(rig: Rig) -> None:
        rig.mount(shape)
        rig.home()
        rig.zero()
        for k in some:
            rig.move_to(x_mm=presses[k].x_mm)
            rig.indent(**{presses[k].kind: presses[k].target}, hold_s=hold_s)
            rig.rest(rest_s)

    script = in_memory(run)
    plan = make_plan(script, config, finger)
    instants = rehearsed(script, config, finger, plan).instants_s
    began_s, ended_s = _presses(instants)
    each_s = np.diff(np.concatenate([[began_s], ended_s]))[1:]
    slope, at_zero = np.polyfit(doi_mm[some][1:], each_s, 1) if np.ptp(doi_mm[some][1:]) > 0 else (0.0, each_s.mean())
    return PressTimes(began_s, np.maximum(at_zero + slope * doi_mm, 1.0), change_s)


def _presses(instants_s: Mapping[Milestone, float]) -> tuple[float, Array]:
    """Return when the first press begins, and when the rest after each one ends (s)."""
    rests = sorted(at for name, at in instants_s.items() if name[0] == "rest")
    return min(at for name, at in instants_s.items() if name[0] == "zero"), np.array(rests)


def in_memory(run: Callable[[Rig], None]) -> Script:
    """Return a function as a script without a file."""
    return Script(Path(__file__), "design", "Designed presses", "docs/design.md", ProtocolParameters(), run)


def allowed(
    config: Config, finger: Finger, table: ResponseTable, hold_s: float, progress: Callable[[int, int], None]
) -> ResponseTable:
    """Return the table of the presses that the planner accepts within the limits.

    Raises DesignError if there are none.
    """
    plan = Plan(predictions=table.predictions)
    walk = Walk(config, FingerModel(finger, plan.predictions, str, config.identified))
    rig = Rig(ProtocolParameters(), walk, Planner(walk, plan))
    unsolved = np.isnan(table.values).any(axis=(0, 2, 3)) | np.isnan(table.about).any(axis=1)
    solved = np.logical_not(unsolved).tolist()
    kept: list[int] = []
    first: BadInputError | None = None
    shape = ""
    for k, press in enumerate(table.presses):
        progress(k, len(table.presses))
        if not solved[k]:
            continue
        if press.shape != shape:
            rig.mount(press.shape)
            rig.home()
            rig.zero()
            shape = press.shape
        try:
            rig.move_to(x_mm=press.x_mm)
            rig.indent(**{press.kind: press.target}, hold_s=hold_s)  # type: ignore[arg-type]
        except BadInputError as error:
            first = first or error
            continue
        kept.append(k)
    if not kept:
        problem = "the finger model solves none of them" if first is None else str(first)
        raise DesignError(
            "no press of {presses} is within the limits: {problem}",
            code="all_refused",
            presses=len(table.presses),
            problem=problem,
        ) from None
    return table.only(kept)
