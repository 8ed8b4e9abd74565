"""How a run ended before its end: where that leaves the indentor, and what to do next.

Terminal, report and JSON all say it in these words.
"""

import math
import shlex
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from rig.data import Run
from rig.data.folder import free_space
from rig.engine import Engine, LimitError, RecordError, RunAborted, ScriptError, TripError
from rig.engine.engine import State
from rig.engine.errors import LostRecordError
from rig.engine.limits import AT_MM
from sim.models.processes.finger_process import FingerLostError

Left = Literal["lifted", "held", "not moved"]

_CLEAR = ("home", "retract", "move", "rest", "zero", "mount", "paused")
_DOING = ("indentation_start", "sample", "touch", "hold_start", "hold_end", "sync")

_FREE_THE_FINGER = "free the finger before anything else, by hand or by the controller's own jog, straight up; then "
_SEE_TO: tuple[tuple[type[Exception], str], ...] = (
    (RunAborted, "see that the finger is well"),
    (TripError, "see that the finger is well, and to what tripped it"),
    (LimitError, "change the script or the limit and begin a new run: resumed, this one meets the same limit"),
    (ScriptError, "correct the script and begin a new run: resumed, this one runs its own copy of the script"),
    (OSError, "free space, then resume"),
    (LostRecordError, "see who moved or deleted the run's files, then resume"),
    (RecordError, "free space, then resume"),
    (FingerLostError, "see whether memory ran out, then resume"),
)
_PUT_RIGHT = "put right what is named, then "
_SEE_TO_THE_DEVICE = "see to the device that is named"


@dataclass(frozen=True)
class Whereabouts:
    """Of the indentor when a run ends: mm from the pad's centre and above its nominal apex, None where not known.

    left: lifted to clearance or higher, held where it was, or not moved by this program. may_touch is None where
    nobody knows.
    """

    left: Left
    x_mm: float | None = None
    height_mm: float | None = None
    trusted: bool = False
    may_touch: bool | None = None

    @classmethod
    def of(cls, engine: Engine) -> "Whereabouts":
        """Where an engine leaves it that goes no farther."""
        if not engine.motion.begun:
            return cls("not moved")
        clearance_mm = engine.settings.habits.clearance_mm - AT_MM
        above = engine.height_mm >= clearance_mm
        lifted = above and engine.bench.stage.homed and engine.state is not State.UNHOMED
        safely_above = above and not engine.may_touch and engine.state is not State.TRIPPED
        return cls(
            "lifted" if lifted else "held",
            _known(engine.x_mm),
            _known(engine.height_mm),
            lifted,  # what is held was stopped, or does not answer
            not (lifted or safely_above),
        )

    @classmethod
    def last_known(cls, run: Run) -> "Whereabouts":
        """Where a run without an end was last known to be: its program was killed, and could not lift."""
        said = [(event["t_s"], stream, event) for stream, found in run.events.items() for event in found]
        said += [(event["t_s"], stream, event) for stream, found in run.superseded.items() for event in found]
        said.sort(key=lambda one: one[0])
        where: dict[str, float | None] = {"x_mm": None, "height_mm": None}
        may_touch: bool | None = None
        for _, stream, event in said:
            for key in where:
                where[key] = event.get(key, where[key])
            if stream in _CLEAR:
                may_touch = False
            elif stream.removeprefix("precondition_").removeprefix("reference_").removeprefix("find_") in _DOING:
                may_touch = True
        return cls("held", where["x_mm"], where["height_mm"], False, may_touch)

    @property
    def words(self) -> str:
        """One line on where it is and whether it touches."""
        if self.left == "not moved":
            return "not moved: nothing was told to move, it is where it was before"
        doubt = "trusted" if self.trusted else "last known and not trusted"
        return f"{self.left}, at {self._place} ({doubt}); {self._touches}"

    @property
    def _place(self) -> str:
        x = "x not known" if self.x_mm is None else f"x = {self.x_mm:.2f} mm"
        height = self.height_mm
        if height is None:
            return f"{x}, height not known"
        return f"{x}, {abs(height):.2f} mm {'above' if height >= 0 else 'below'} the nominal apex"

    @property
    def _touches(self) -> str:
        if self.may_touch is None:
            return "whether it touches the finger is not known"
        return "it may still touch the finger" if self.may_touch else "it does not touch the finger"


@dataclass(frozen=True)
class Ending:
    """Why a run ended before its end, where the indentor is, what to do next, and how the run goes on."""

    reason: str
    at: Whereabouts
    next: str  # for whoever stands there
    resume: str | None  # what to type; nothing of a run that has not begun

    @classmethod
    def of(cls, problem: Exception | None, at: Whereabouts, folder: Path) -> "Ending":
        """Of a run in a folder; no problem: its script ended with less than was planned."""
        if problem is None:
            return cls("the script did less than was planned", at, _next(ScriptError(), at), resume_line(folder))
        return cls(_reason(problem, folder), at, _next(problem, at), resume_line(folder))

    @classmethod
    def killed(cls, run: Run) -> "Ending":
        """Of a run whose journal has no end."""
        at = Whereabouts.last_known(run)
        reason = "the run ended without its end: its program was killed, or the power failed"
        return cls(reason, at, _next(RunAborted(), at), resume_line(run.folder.path))

    @classmethod
    def before_it_began(cls, reason: str, *, refused: bool) -> "Ending":
        """Of a run that was refused, or left, before anything could move."""
        return cls(reason, Whereabouts("not moved"), f"{_PUT_RIGHT if refused else ''}the same again", None)

    @property
    def told(self) -> dict[str, str]:
        """Lines for people: what about, and the words."""
        lines = {"where": self.at.words, "next": self.next, "resume": self.resume}
        return {about: words for about, words in lines.items() if words is not None}

    def as_json(self) -> dict[str, Any]:
        """Numbers, and the same words."""
        return {"reason": self.reason, "indentor": asdict(self.at), "words": self.at.words, "next": self.next,
                "resume": self.resume}  # fmt: skip


def resume_line(folder: Path) -> str:
    """What to type, from any folder, to go on with a run."""
    return f"rig resume {shlex.quote(str(folder.resolve()))}"


def _reason(problem: Exception, folder: Path) -> str:
    """In one line; of a full disk with the room that there is, and the remedy."""
    reason = " ".join(str(problem).split())
    if isinstance(problem, LostRecordError):
        return f"{reason}; what was recorded is in {folder.resolve()}: {resume_line(folder)}"
    if isinstance(problem, RecordError):
        reason = f"{reason}, {free_space(folder)}"
    if isinstance(problem, RecordError | OSError):
        reason = f"{reason}: free space, then {resume_line(folder)}"
    return reason


def _next(problem: Exception, at: Whereabouts) -> str:
    """What whoever stands there is to do; resuming homes, which lifts first."""
    known = (words for kind, words in _SEE_TO if isinstance(problem, kind))
    see_to = next(known, _SEE_TO_THE_DEVICE)
    return see_to if at.may_touch is False or at.left == "not moved" else _FREE_THE_FINGER + see_to


def _known(mm: float) -> float | None:
    return round(mm, 6) if math.isfinite(mm) else None
