"""Expected duration of an identification, from the rehearsal of as many presses on springs."""

from itertools import cycle, islice
from typing import NamedTuple

from rig.errors import BadInputError
from rig.identify.adaptive_presses import PLACES_MM, IdentificationOptions
from rig.identify.identification_script import as_script
from rig.plan.config import Config
from rig.plan.plan import make_plan
from rig.protocol.api import Rig
from rig.session.rehearse import rehearsed
from sim.contact.shapes import ShapeError
from sim.errors import ModelRangeError
from sim.finger_process import Finger

_DEPTHS_MM = (0.6, 0.45, 0.3, 0.2)
"""Depths of the rehearsed presses, the deepest that finger and limits allow: near the middle of the usual ones."""


class ExpectedDuration(NamedTuple):
    """Duration without the time to mount indentors (s): of all presses with homing, and of one more press."""

    total_s: float
    press_s: float


def expected_duration(config: Config, options: IdentificationOptions, finger: Finger) -> ExpectedDuration | None:
    """Return the expected duration of the most presses; None if the configured finger refuses all depths."""
    for doi_mm in _DEPTHS_MM:
        try:
            one_s, total_s = (_rehearsed_s(config, options, finger, n, doi_mm) for n in (1, options.presses + 1))
        except (BadInputError, ShapeError, ModelRangeError):
            continue
        press_s = (total_s - one_s) / options.presses
        return ExpectedDuration(total_s - press_s, press_s)
    return None


def _rehearsed_s(
    config: Config, options: IdentificationOptions, finger: Finger, presses: int, doi_mm: float
) -> float:
    def run(rig: Rig) -> None:
        rig.mount(options.shapes[0])
        rig.home()
        for n, x_mm in enumerate(islice(cycle(PLACES_MM), presses)):
            if n:
                rig.mount(options.shapes[n % len(options.shapes)])
            rig.move_to(x_mm=x_mm)
            rig.zero()
            rig.indent(doi_mm=doi_mm, hold_s=options.hold_s)

    script = as_script(run)
    return rehearsed(script, config, finger, make_plan(script, config, finger)).duration_s
