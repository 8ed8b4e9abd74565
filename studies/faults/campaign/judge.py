"""What a case must hold: the force within its bound, the report true, nothing lost or repeated, nothing crashed.

The bound is the soft trip and the overshoot of docs/safety.md. What a program reports of the indentor is read in one
place, `claim_of`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from rig.engine.bench_memory import LastKnown
from rig.session.early_ending import FinalPosition
from studies.faults.campaign.faults import GOES_FARTHER, MOVES_WITHOUT_COMMAND, READS_LOW
from studies.faults.faulty_bench import bound_gwt

Claim = Literal["clear", "touching", "not confirmed", "none"]

TOUCH_GWT = 0.05
"""habits.touch_force_gwt: from here on the finger is touched."""
DRAG_MM = 0.003
"""A step of the stage: less is no motion sideways."""
BOUND_GWT = bound_gwt()
HALF = "reads 0.5"
"""A cell that must stay within the bound alone, and in a press by increments."""


def claim_of(at: FinalPosition | None) -> Claim:
    """What a final report claims about contact.

    clear: the finger is not touched. touching: it is. not confirmed: it may be, or nobody knows.
    """
    if at is None or at.left == "not moved":
        return "none"
    return "clear" if at.may_touch is False else "not confirmed"


def claim_on_record(known: LastKnown) -> Claim:
    """The same of what the next command will read about the bench."""
    contact: Any = getattr(known, "contact", None)
    if contact is None:
        return "none"
    return "not confirmed" if contact.may_touch else "clear"


def hidden(cell: str) -> float:
    """How many times the touch threshold a cell hides: twice, where it reads half."""
    return 2.0 if cell == "reads 0.5" else 1.0


def true_claim(claim: Claim, force_gwt: float, cell: str = "none") -> bool:
    """Whether a claim is true of a finger that feels this force under such a cell."""
    if claim == "clear":
        return force_gwt < TOUCH_GWT * hidden(cell)
    return force_gwt > 0.0 if claim == "touching" else True


@dataclass(frozen=True)
class Exemption:
    """What no program can prevent, and the mechanical remedy; its bound is measured, in docs/validation/faults.md."""

    name: str
    remedy: str


LOW = Exemption("a cell that reads low by more than half", "a second cell, or a mechanical stop at the deepest DOI")
UNCOMMANDED = Exemption(
    "a stage that moves without a command", "a mechanical stop; an emergency stop in the motors' supply"
)
BYPASSED = Exemption(
    "a cell that is bypassed, on a carriage that goes farther than told", "a mechanical stop at the deepest DOI"
)
FAST_AND_LOW = Exemption(
    "in a ramp, a cell that reads half, on a carriage that goes farther than told",
    "increments instead of a ramp; a mechanical stop at the deepest DOI",
)
EXEMPTIONS = (LOW, UNCOMMANDED, BYPASSED, FAST_AND_LOW)


def exemption_of(record: Mapping[str, Any]) -> Exemption | None:
    """Which of the allowed exceptions a case is, if any.

    A cell that shows nothing of the finger from before the touch on is a bypassed one. It is spared only where the
    carriage goes farther than told, too: alone it must stay within the bound.
    """
    if record["cell"] in READS_LOW:
        return LOW
    if record["mechanics"] in MOVES_WITHOUT_COMMAND:
        return UNCOMMANDED
    in_air = record["struck_gwt"] < TOUCH_GWT
    if record["cell"] == "frozen" and in_air and record["mechanics"] in GOES_FARTHER:
        return BYPASSED
    if record["scenario"] == "ramp" and record["cell"] == HALF and record["mechanics"] in GOES_FARTHER:
        return FAST_AND_LOW
    return None


def violations(record: Mapping[str, Any]) -> list[str]:
    """What a case breaks, by class; the classes are the columns of the table."""
    found = []
    if record["worst_gwt"] > BOUND_GWT:
        found.append("force")
    if record["drag_mm"] > DRAG_MM:
        found.append("sideways")
    if not (record["report_true"] and record["record_true"]):
        found.append("report")
    if record["lost"] or record["repeated"] or record["mixed"]:
        found.append("lost or repeated")
    if record["resumed"] is False:
        found.append("not resumed")
    if record["exit"] == "crashed":
        found.append("crash")
    return found
