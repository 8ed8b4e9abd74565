"""The verbs of a script as data: one step a verb, one file a step."""

from rig.protocol.steps.base import Journalled, Owed, Step
from rig.protocol.steps.home_step import Home
from rig.protocol.steps.indent_step import Indent
from rig.protocol.steps.mount_step import Mount
from rig.protocol.steps.move_to_step import MoveTo
from rig.protocol.steps.precondition_step import Precondition
from rig.protocol.steps.presses import ExpectedPresses
from rig.protocol.steps.reference_step import Reference
from rig.protocol.steps.rest_step import Rest
from rig.protocol.steps.retract_step import Retract
from rig.protocol.steps.touch_step import ExpectedTouch, Touch
from rig.protocol.steps.words_step import Checkpoint, Note
from rig.protocol.steps.zero_step import Zero

__all__ = [
    "Checkpoint",
    "ExpectedPresses",
    "ExpectedTouch",
    "Home",
    "Indent",
    "Journalled",
    "Mount",
    "MoveTo",
    "Note",
    "Owed",
    "Precondition",
    "Reference",
    "Rest",
    "Retract",
    "Step",
    "Touch",
    "Zero",
]
