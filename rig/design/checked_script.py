"""Check of a designed script: planned and rehearsed like any other, and shortened until it fits into the session."""

import tempfile
from pathlib import Path
from typing import NamedTuple

from rig.compare.plausible_fingers import PlausibleFingers
from rig.design.design import Design, shortened, with_own_outcome
from rig.design.design_text import about_the_design
from rig.design.designed import as_block
from rig.design.exceptions import DesignError
from rig.design.script_text import script_text
from rig.plan.config import Config
from rig.plan.plan import make_plan
from rig.protocol.script import load_script
from rig.session.rehearse import rehearsed
from sim.finger_process import Finger

_ROUNDS = 8


class CheckedScript(NamedTuple):
    """A design with its script, which the planner accepts, and its rehearsed duration with changes (s)."""

    design: Design
    text: str
    duration_s: float


def checked_script(
    found: Design, config: Config, finger: Finger, plausible: PlausibleFingers | None, command: str
) -> CheckedScript:
    """Return the script of a design; its last presses are left out if the rehearsal takes longer than the session.

    Raises BadInputError if the planner refuses it, EngineError if the rehearsal fails.
    """
    request = found.request
    asked = len(found.made.order)
    for _ in range(_ROUNDS):
        block, about = as_block(request, plausible), about_the_design(found)
        text = script_text(found.blocks, found.table.presses, about, command, request.hold_s, request.rest_s, block)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "designed.py"
            path.write_text(text, encoding="utf-8")
            script = load_script(str(path))
            plan = make_plan(script, config, finger, known=found.table.predictions)
            # A quick design trusts the times of the presses that were rehearsed to plan it.
            rehearsal_s = (
                found.times.session_s(found.made.order.tolist(), 1)
                if request.quick
                else rehearsed(script, config, finger, plan).duration_s
            )
        duration_s = rehearsal_s + request.change_s * (len(found.blocks) - 1)
        over_s = duration_s - 60 * request.minutes
        if over_s <= 0:
            done = found if len(found.made.order) == asked else with_own_outcome(found)
            return CheckedScript(done, text, duration_s)
        fewer = max(1, round(over_s / float(found.times.press_s.mean())))
        if fewer >= len(found.made.order):
            break
        found = shortened(found, len(found.made.order) - fewer)
    raise DesignError(
        f"{request.minutes:g} minutes are too short: the shortest script takes {duration_s:.0f} s", "too_few_minutes"
    )
