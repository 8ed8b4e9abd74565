"""Notice of a trip, a stop or another early end: what a person must know now, and do.

While a process owns the rig, the notice is that of its run or of manual control. Afterwards it follows from what is
on disk, so that a restarted panel shows the same one: the ending of the last run, the last stop or trip under manual
control, and the record of contact. It stands until a later command has homed or lifted.
"""

import math
from collections.abc import Mapping
from typing import Any, Protocol

from rig.engine.bench_memory import LastKnown
from rig.engine.contact_words import FREE_THE_FINGER
from rig.manual.orders import HOME_FIRST

Notice = dict[str, Any]
"""`attention` of the state."""

IN_CONTACT = "in contact"
"""Status of a notice without an ending: the record of contact shows no lift."""

_THEN_HOME = "then home: nothing else moves before, and homing starts with a lift"
_NO_LIFT = "no lift is on record after the last motion"


class LastRun(Protocol):
    """Last run on the rig, whose process has gone (rig/panel/run_view.py: RunView)."""

    @property
    def ended_s(self) -> float: ...
    @property
    def moved(self) -> bool: ...
    def attention(self, *, going: bool, stopped: bool) -> Notice | None: ...


def notice(
    status: str, reason: str, where: str, to_do: str, resume: str | None = None, *, may_touch: bool = True
) -> Notice:
    """Return a notice."""
    return {
        "status": status,
        "reason_text": reason,
        "where_text": where,
        "next_text": to_do,
        "resume": resume,
        "may_touch": may_touch,
    }


def stopped_now() -> Notice:
    """Return the notice between a stop and the ending of the run, which says where the indentor is."""
    where = "the stage was stopped where it was; the indentor may still press the finger"
    return notice("aborted", "stopped", where, FREE_THE_FINGER)


def manual_notice(status: Mapping[str, Any]) -> Notice | None:
    """Return the notice after a stop or a trip under manual control; status: the last reply of its process."""
    if status.get("next") != HOME_FIRST:
        return None
    word = "aborted" if status.get("stopped") else "tripped"
    return _manual(word, status.get("ended_by") or "stopped", status.get("contact") or {})


def _manual(status: str, reason: str, contact: Mapping[str, Any]) -> Notice:
    where = contact.get("where_text") or "it is unknown whether the indentor touches the finger"
    free = contact.get("to_do_text")
    to_do = f"{free}; {_THEN_HOME}" if free else HOME_FIRST
    return notice(status, reason, where, to_do, may_touch=contact.get("may_touch") is not False)


def standing_notice(run: LastRun | None, known: LastKnown) -> Notice | None:
    """Return the notice while no process owns the rig. run: the last one on the rig. known: the record of the rig.

    The later ending counts, of the run or under manual control, unless the indentor was lifted since: after a run by
    a command that began later. Where a later command has left the finger pressed, or the run has moved nothing, the
    record says where the indentor is.
    """
    end, contact = known.manual_end, known.contact
    aged = None if contact is None else contact.after(math.inf, trusted=known.left_at_mm is not None)
    found, lifted, moved, left_by_it = None, False, True, False
    if end is not None and (run is None or end.unix_s > run.ended_s):
        found = _manual(end.status, end.reason, {} if aged is None else aged.as_json())
        lifted, left_by_it = known.lifted_unix_s > end.unix_s, contact is not None and contact.unix_s <= end.unix_s
    elif run is not None:
        found, moved = run.attention(going=False, stopped=False), run.moved
        lifted, left_by_it = known.lifted_by_unix_s > run.ended_s, known.contact_by_unix_s <= run.ended_s
    if lifted:
        found = None
    if contact is None or aged is None:
        return found
    if contact.kind in ("lifted", "raised"):
        return found and found | {"where_text": aged.words}
    if found is None:
        return notice(IN_CONTACT, _NO_LIFT, aged.words, aged.to_do or HOME_FIRST)
    if moved and left_by_it:
        return found
    return found | {"where_text": aged.words, "next_text": aged.to_do or HOME_FIRST, "may_touch": True}
