"""State of contact between indentor and finger, defined once for engine, commands and records.

*Lifted* is measured: the force at rest is below the touch threshold, and the position is at clearance or higher.
Every other state names what is missing, and what to do. A finger moves, so a measurement has an age: after `FRESH_S`
the state is that of its time, and unknown since.
"""

import math
from dataclasses import dataclass, field, replace
from typing import Self, get_args

from rig.devices.base import StageStatus
from rig.engine.contact_words import ContactWords
from rig.engine.limits import AT_MM
from rig.records import ContactKind
from rig.settings import RigSettings

KINDS: tuple[ContactKind, ...] = get_args(ContactKind)

FRESH_S = 1.0
"""Longest age of a measurement at rest that still shows whether a finger is touched (s)."""


@dataclass(frozen=True)
class KnownContact(ContactWords):
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


@dataclass(frozen=True)
class ContactRecord:
    """Contact as an engine knows it: the last measurement at rest, and what has happened since.

    measured_s: time of the measurement on a clock that also counts while the computer sleeps. at_rest: whether
    nothing has moved since. may_touch: whether the indentor was below clearance since the last lift or homing.
    force_gwt: last reading from a zero, in a motion as well. lifted_off_s: time of the first one without a touch
    since the last touch, on the clock of the bench; None while a touch is read. unread: why the last force at rest is
    missing.
    """

    measured: KnownContact = field(default_factory=KnownContact)
    measured_s: float = -math.inf
    at_rest: bool = False
    may_touch: bool = False
    force_gwt: float | None = None
    lifted_off_s: float | None = -math.inf
    unread: str | None = None

    def is_fresh(self, now_s: float) -> bool:
        """Return whether the measurement still shows whether a finger is touched."""
        return now_s - self.measured_s <= FRESH_S

    def after_force(self, force_gwt: float | None, touch_gwt: float, clock_s: float) -> Self:
        """Return the contact after a reading from a zero (gwt), or after one without a zero (None)."""
        if force_gwt is None:
            return replace(self, force_gwt=None)
        touches = abs(force_gwt) >= touch_gwt
        first_s = clock_s if self.lifted_off_s is None else self.lifted_off_s
        return replace(self, force_gwt=force_gwt, lifted_off_s=None if touches else first_s)

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


def contact_kind(*, clear: bool, force_gwt: float | None, touch_gwt: float) -> ContactKind:
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
) -> KnownContact:
    """Return the state of contact at a place, judged from position and force.

    placed: whether the position is trusted. force_gwt, touch_gwt: as for `contact_kind`.
    """
    x_mm = round(at.x_mm - settings.frame.pad_centre_x_mm, 6) if placed else None
    height_mm = at.z_mm - settings.frame.apex_z_mm if placed else None
    clear = height_mm is not None and height_mm >= settings.habits.clearance_mm - AT_MM
    kind = contact_kind(clear=clear, force_gwt=force_gwt, touch_gwt=touch_gwt)
    return KnownContact(kind, force_gwt, x_mm, height_mm, unix_s)
