"""Words and JSON of a state of contact, which rig/engine/contact.py judges."""

from abc import abstractmethod
from collections.abc import Mapping
from datetime import datetime

from rig.records import ContactKind
from rig_shared.outputs import Output

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


class ContactWords:
    """Words for the state of contact between indentor and finger, the same in commands, pages and records."""

    kind: ContactKind
    force_gwt: float | None
    x_mm: float | None
    height_mm: float | None
    unix_s: float
    aged: bool

    @property
    @abstractmethod
    def may_touch(self) -> bool:
        """Whether the indentor may touch the finger."""

    @property
    def words(self) -> str:
        """One sentence with the position."""
        if self.kind == "lifted":
            return f"lifted, at {self.place}; {self.clause}"
        if self.kind == "raised":
            return f"raised to {self.place}; {self.clause}"
        if self.kind == "disagreement":
            return f"the stage reports {self.place}{'; ' if self.aged else ', '}{self.clause}"
        if self.x_mm is None and self.height_mm is None:
            return f"at an unknown position; {self.clause}"
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
