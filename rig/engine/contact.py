"""State of contact between indentor and finger, defined once for engine, commands and records.

*Lifted* is measured: the force at rest is below the touch threshold, and the position is at clearance or higher.
Every other state names what is missing, and what to do. A finger moves, so a measurement has an age: after `FRESH_S`
the state is that of its time, and unknown since.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime
from typing import Self, get_args

from rig.devices.base import StageStatus
from rig.engine.limits import AT_MM
from rig.records import ContactKind
from rig.settings import RigSettings
from rig_shared.outputs import Output

KINDS: tuple[ContactKind, ...] = get_args(ContactKind)

FRESH_S = 1.0
"""Longest age of a measurement at rest that still shows whether a finger is touched (s)."""

DOES_NOT_TOUCH = "the indentor does not touch the finger"
MAY_TOUCH = "the indentor may still touch the finger"
FREE_THE_FINGER = "free the finger first, straight up: by hand or with the controller's own jog"
_TO_DO: Mapping[ContactKind, str | None] = {
    "lifted": None,
    "raised": (
        "look at the finger before you touch the rig; `rig zero`, then `rig home` confirm by force that it is free"
    ),
    "disagreement": (
        "look at the finger: if the indentor touches it, free it by hand; if not, run `rig zero --anyway`, "
        "then `rig home`"
    ),
    "touching": FREE_THE_FINGER,
    "unknown": FREE_THE_FINGER,
}


class ContactJson(Output):
    """State of contact between indentor and finger; null where nothing is on record.

    measured_unix_s: when force and position were measured; null where the force never was.
    """

    contact: ContactKind | None
    may_touch: bool | None
    force_gwt: float | None
    measured_unix_s: float | None
    where_text: str
    to_do_text: str | None


@dataclass(frozen=True)
class KnownContact:
    """Known state of contact between indentor and finger.

    `lifted`: confirmed by position and force. `raised`: at clearance by position, without a force. `disagreement`: at
    clearance by position, and the force shows a touch. `touching`: the force shows a touch anywhere else. `unknown`:
    none of these. Places are in mm from the pad's center and above its nominal apex; `unix_s` is 0 where only the
    order of events matters; `aged` is measured longer than `FRESH_S` ago, so that the contact is unknown since.
    """

    kind: ContactKind = "unknown"
    force_gwt: float | None = None
    x_mm: float | None = None
    height_mm: float | None = None
    unix_s: float = 0.0
    aged: bool = False

    def after(self, age_s: float, *, trusted: bool) -> "KnownContact":
        """Return what is still known when the measurement has an age (s); trusted: whether the position is."""
        fresh = 0.0 <= age_s <= FRESH_S  # A clock may have jumped back.
        kind = self.kind
        if kind == "lifted" and not (fresh and trusted):
            kind = "raised" if trusted else "unknown"
        elif kind in ("raised", "disagreement") and not trusted:
            kind = "touching" if kind == "disagreement" else "unknown"
        return replace(self, kind=kind, aged=self.aged or not (fresh or self.force_gwt is None))

    @property
    def may_touch(self) -> bool:
        """Whether the indentor may touch the finger: true unless a lift is confirmed."""
        return self.kind != "lifted"

    @property
    def words(self) -> str:
        """One sentence with the position."""
        if self.kind == "lifted":
            return f"lifted, at {self.place}; {self.clause}"
        if self.kind == "raised":
            return f"raised to {self.place}; {self.clause}"
        if self.kind == "disagreement":
            return f"the stage reports {self.place}{'; ' if self.aged else ', '}{self.clause}"
        return f"last known at {self.place}; {self.clause}"

    @property
    def clause(self) -> str:
        """State of contact in words, without the position."""
        if self.aged:
            position = "by position only; " if self.kind == "raised" else ""
            return f"{position}{self._measured}, and unknown since because a finger moves; {MAY_TOUCH}"
        if self.kind == "lifted":
            return f"{self._force}, so {DOES_NOT_TOUCH}"
        if self.kind == "raised":
            return f"by position only, not confirmed by force; {MAY_TOUCH}"
        if self.kind == "disagreement":
            return (
                f"but the sensor reads {self._force}: the motor may have stalled or the zero may have drifted; "
                f"{MAY_TOUCH}"
            )
        return f"{self._force}; {MAY_TOUCH}"

    @property
    def to_do(self) -> str | None:
        """First step for the operator; None if nothing needs to be done."""
        return _TO_DO[self.kind]

    @property
    def place(self) -> str:
        """Last known position, in words."""
        x = "x unknown" if self.x_mm is None else f"x = {self.x_mm:.2f} mm"
        if self.height_mm is None:
            return f"{x}, height unknown"
        return f"{x}, {abs(self.height_mm):.2f} mm {'above' if self.height_mm >= 0 else 'below'} the nominal apex"

    def as_json(self) -> ContactJson:
        """Return the state as commands print it."""
        return {
            "contact": self.kind, "may_touch": self.may_touch, "force_gwt": self.force_gwt,
            "measured_unix_s": self.unix_s or None, "where_text": self.words, "to_do_text": self.to_do,
        }  # fmt: skip

    @property
    def _force(self) -> str:
        return "force unknown" if self.force_gwt is None else f"{self.force_gwt:.2f} gwt"

    @property
    def _measured(self) -> str:
        when = f" at {datetime.fromtimestamp(self.unix_s):%Y-%m-%d %H:%M:%S}" if self.unix_s else ""
        return f"last measured{when}: {self._force}"


@dataclass(frozen=True)
class ContactRecord:
    """Contact as an engine knows it: the last measurement at rest, and what has happened since.

    measured_s: time of the measurement on a clock that also counts while the computer sleeps. at_rest: whether
    nothing has moved since. may_touch: whether the indentor was below clearance since the last lift or homing.
    force_gwt: last reading from a zero, in a motion as well. unread: why the last force at rest is missing.
    """

    measured: KnownContact = field(default_factory=KnownContact)
    measured_s: float = -math.inf
    at_rest: bool = False
    may_touch: bool = False
    force_gwt: float | None = None
    unread: str | None = None

    def is_fresh(self, now_s: float) -> bool:
        """Return whether the measurement still shows whether a finger is touched."""
        return now_s - self.measured_s <= FRESH_S

    def after_measuring(self, found: KnownContact, now_s: float) -> Self:
        """Return the contact just measured at rest; a confirmed lift ends a possible touch."""
        may_touch = self.may_touch and found.may_touch
        return replace(self, measured=found, measured_s=now_s, at_rest=True, may_touch=may_touch)

    def after_reading(self, found: KnownContact, now_s: float, touch_gwt: float) -> Self:
        """Return a measured lift as a reading above clearance leaves it: ended by a touch, or renewed while fresh.

        found: the lift with this force. Readings that follow each other within `FRESH_S` need no second one that
        agrees.
        """
        if self.may_touch or self.measured.kind != "lifted" or found.force_gwt is None:
            return self
        if abs(found.force_gwt) >= touch_gwt:
            return replace(self, measured=replace(found, kind="disagreement"), measured_s=now_s)
        return replace(self, measured=found, measured_s=now_s) if self.is_fresh(now_s) else self


def judged(*, clear: bool, force_gwt: float | None, touch_gwt: float) -> ContactKind:
    """Return the state of contact at rest; `clear` is a trusted position at clearance or higher.

    The force from zero is None where the sensor does not answer or was never zeroed; push and pull count alike.
    """
    if force_gwt is None:
        return "raised" if clear else "unknown"
    if abs(force_gwt) >= touch_gwt:
        return "disagreement" if clear else "touching"
    return "lifted" if clear else "unknown"


def contact_at(
    settings: RigSettings,
    at: StageStatus,
    *,
    placed: bool,
    force_gwt: float | None,
    touch_gwt: float,
    unix_s: float,
    kind: ContactKind | None = None,
) -> KnownContact:
    """Return the state of contact at a place, judged from position and force unless `kind` is given.

    placed: whether the position is trusted. force_gwt, touch_gwt: as for `judged`.
    """
    x_mm = round(at.x_mm - settings.frame.pad_centre_x_mm, 6) if placed else None
    height_mm = at.z_mm - settings.frame.apex_z_mm if placed else None
    clear = height_mm is not None and height_mm >= settings.habits.clearance_mm - AT_MM
    found = kind or judged(clear=clear, force_gwt=force_gwt, touch_gwt=touch_gwt)
    return KnownContact(found, force_gwt, x_mm, height_mm, unix_s)
