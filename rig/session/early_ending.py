"""Early end of a run: reason, final position of the indentor, and next action.

Terminal, report and JSON use the same sentences.
"""

import math
import shlex
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

from rig.data.ending import EndingJson, IndentorAtEndJson, Left
from rig.data.folder import RunFolder, allowed, free_space, how_to_write
from rig.data.run_state import RunState
from rig.data.run_status import RunStatus, reason_of
from rig.engine import Engine, RecordError, RunAborted, ScriptError
from rig.engine.contact import KnownContact
from rig.engine.limits import AT_MM
from rig.errors import LimitError, LostRecordError, TripError
from rig.records import ContactKind

_PUT_RIGHT = "correct the problem, then "
_SEE_TO_THE_DEVICE = "check the device that failed"


class EndedRun(Protocol):
    """Run that has ended, as its journal describes it."""

    @property
    def stop(self) -> Mapping[str, Any] | None: ...
    @property
    def state(self) -> RunState: ...
    @property
    def folder(self) -> RunFolder: ...


@dataclass(frozen=True)
class FinalPosition:
    """Final position of the indentor: mm from the pad's center and above its nominal apex, None if unknown.

    left: lifted (at clearance or higher, confirmed by force), raised (there by position alone), held in place, or
    not moved by this program. contact is None in journals from before contact was measured.
    """

    left: Left
    x_mm: float | None = None
    height_mm: float | None = None
    trusted: bool = False
    may_touch: bool | None = None
    contact: ContactKind | None = None
    force_gwt: float | None = None
    measured_unix_s: float | None = None
    aged: bool = False  # Since that measurement nothing is known about contact.

    @classmethod
    def of(cls, engine: Engine) -> "FinalPosition":
        """Return the final position of an engine."""
        if not engine.motion.begun:
            return cls("not moved")
        known = engine.known_contact
        above = engine.height_mm >= engine.settings.habits.clearance_mm - AT_MM
        trusted = engine.trusted
        left: Left = "held" if not (above and trusted) else "raised" if known.may_touch else "lifted"
        return cls(
            left, _known(engine.x_mm), _known(engine.height_mm), left != "held",  # A held stage was stopped.
            known.may_touch, known.kind, known.force_gwt, known.unix_s, known.aged,
        )  # fmt: skip

    @classmethod
    def last_known(cls, run: EndedRun) -> "FinalPosition":
        """Return the last known position of a run without an end, whose killed program could not lift."""
        state = run.state
        at = cls("held", state.x_mm, state.height_mm)
        if state.contact is None:
            return at
        last = KnownContact(state.contact, state.force_gwt, unix_s=state.unix_s or 0.0)
        known = last.after(math.inf, trusted=False)
        return replace(
            at, may_touch=True, contact=known.kind, force_gwt=known.force_gwt, measured_unix_s=known.unix_s,
            aged=known.aged,
        )  # fmt: skip

    @property
    def words(self) -> str:
        """One line on position and contact."""
        if self.left == "not moved":
            return "not moved; it is where it was before"
        doubt = "trusted" if self.trusted else "last known and not trusted"
        found = self._found
        if self.contact is None and self.may_touch is None:
            return f"{self.left}, at {found.place} ({doubt}); it is unknown whether the indentor touches the finger"
        return f"{self.left}, at {found.place} ({doubt}); {found.clause}"

    @property
    def to_do(self) -> str | None:
        """First step for the operator about the indentor, or None."""
        return None if self.left == "not moved" or self.may_touch is False else self._found.to_do

    def as_json(self) -> IndentorAtEndJson:
        """Return the position as commands print it."""
        return {
            "left": self.left, "x_mm": self.x_mm, "height_mm": self.height_mm, "trusted": self.trusted,
            "may_touch": self.may_touch, "contact": self.contact, "force_gwt": self.force_gwt,
            "measured_unix_s": self.measured_unix_s, "aged": self.aged,
        }  # fmt: skip

    @property
    def _found(self) -> KnownContact:
        kind = self.contact
        if kind is None:  # from before contact was measured
            kind = "raised" if self.left == "lifted" else "unknown"
        return KnownContact(
            kind, self.force_gwt, self.x_mm, self.height_mm, self.measured_unix_s or 0.0, aged=self.aged
        )


@dataclass(frozen=True)
class Ending:
    """Early end of a run: reason, final position, next action, and how to resume."""

    reason: str
    at: FinalPosition
    next: str  # for the operator
    resume: str | None  # command that resumes the run; None for a run that did not begin

    @classmethod
    def of(cls, problem: Exception | None, at: FinalPosition, folder: Path) -> "Ending":
        """Return the ending of a run in a folder; without a problem, its script ended with less than was planned."""
        if problem is None:
            return cls(reason_of(RunStatus.INCOMPLETE), at, _next(ScriptError(), at), resume_line(folder))
        return cls(_reason(problem, folder), at, _next(problem, at), resume_line(folder))

    @classmethod
    def killed(cls, run: EndedRun) -> "Ending":
        """Return the ending of a run whose journal has no end."""
        at = FinalPosition.last_known(run)
        return cls(reason_of(RunStatus.KILLED), at, _next(RunAborted(), at), resume_line(run.folder.path))

    @classmethod
    def recorded(cls, run: EndedRun, status: RunStatus) -> "Ending":
        """Return the ending of a run from its journal, in which a stop has no error, and an old one no position."""
        assert run.stop is not None
        at = FinalPosition(**run.stop["indentor"]) if "indentor" in run.stop else FinalPosition.last_known(run)
        error = _ERRORS.get(status)
        see_to = f"{_PUT_RIGHT}resume" if error is None else error.remedy
        to_do = see_to if at.to_do is None else f"{at.to_do}; then {see_to}"
        return cls(reason_of(status, run.stop), at, to_do, resume_line(run.folder.path))

    @classmethod
    def before_it_began(cls, reason: str, *, refused: bool) -> "Ending":
        """Return the ending of a run that was refused or left before anything could move."""
        return cls(reason, FinalPosition("not moved"), f"{_PUT_RIGHT if refused else ''}repeat the command", None)

    @property
    def lines(self) -> dict[str, str]:
        """Lines to print, by label."""
        found = {"where": self.at.words, "next": self.next, "resume": self.resume}
        return {about: words for about, words in found.items() if words is not None}

    def as_json(self) -> EndingJson:
        """Return the ending as commands print it."""
        return {"reason_text": self.reason, "indentor": self.at.as_json(), "where_text": self.at.words,
                "next_text": self.next, "resume": self.resume}  # fmt: skip


_ERRORS: dict[RunStatus, type[LimitError | TripError | RunAborted | ScriptError]] = {
    RunStatus.LIMITED: LimitError,
    RunStatus.TRIPPED: TripError,
    RunStatus.ABORTED: RunAborted,
    RunStatus.INCOMPLETE: ScriptError,
}
"""Errors that say what to do about a run that ended in a state."""


def resume_line(folder: Path) -> str:
    """Return the command that resumes a run from any folder."""
    return f"rig resume {shlex.quote(str(folder.resolve()))}"


def _reason(problem: Exception, folder: Path) -> str:
    """Return the reason in one line; for a full disk, with the free space and the remedy."""
    reason = " ".join(str(problem).split())
    if isinstance(problem, LostRecordError):
        return f"{reason}; the recorded data are in {folder.resolve()}; resume with {resume_line(folder)}"
    if isinstance(problem, RecordError) and allowed(problem):
        reason = f"{reason}, {free_space(folder)}"
    if isinstance(problem, RecordError | OSError):
        reason = f"{reason}; {how_to_write(problem)}, then resume with {resume_line(folder)}"
    return reason


def _next(problem: Exception, at: FinalPosition) -> str:
    """Return the next action for the operator; resuming homes, which lifts first."""
    see_to = getattr(problem, "remedy", None)
    if see_to is None:
        unwritable = isinstance(problem, RecordError | OSError)
        see_to = f"{how_to_write(problem)}, then resume" if unwritable else _SEE_TO_THE_DEVICE
    return see_to if at.to_do is None else f"{at.to_do}; then {see_to}"


def _known(mm: float) -> float | None:
    return round(mm, 6) if math.isfinite(mm) else None
