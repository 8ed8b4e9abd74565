"""Comparison of the steps of a resumed run with those in its journal: another order is another run."""

import json
import math
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from numbers import Integral, Real
from pathlib import Path
from typing import Any

from rig.data.planned_presses import is_alike, planned_steps
from rig.errors import BadInputError
from rig.protocol.check import PressPlace
from rig.protocol.steps import Asked, Checkpoint, Journalled, Note, Ramp, Rest, Step
from rig.records import Purpose

_NOT_ASKED = ("index", "t_s", "contact_height_mm", "predicted_doi_mm", "predicted_force_gwt")
_REPORTED = (Note.verb, Rest.verb)
"""Verbs of steps that may differ, which is reported."""
_STARTS: dict[Purpose, str] = {
    "data": "indentation_start",
    "precondition": "precondition_indentation_start",
    "reference": "reference_indentation_start",
    "find": "find",
}


class _Comparison:
    """Comparison of steps. Once it has refused one it refuses all others, since a script may catch the refusal."""

    def __init__(self) -> None:
        self.differences: list[str] = []
        self._refusal: BadInputError | None = None

    @contextmanager
    def _for_good(self) -> Iterator[None]:
        if self._refusal is not None:
            raise self._refusal
        try:
            yield
        except BadInputError as refusal:
            self._refusal = refusal
            raise

    def end(self) -> None:
        """Raise the refusal that a script caught."""
        with self._for_good():
            pass


class SameSteps(_Comparison):
    """Steps in the journal of a stopped run, to be compared with those that its script makes now."""

    def __init__(self, before: Journalled) -> None:
        super().__init__()
        self._recorded = dict(_recorded(before))
        self._texts = {
            Note.verb: [str(event.get("text", "")) for event in before.stream("note")],
            Checkpoint.verb: [str(event["name"]) for event in before.stream("checkpoint") if "name" in event],
        }
        self._rests_s = [float(event["rest_s"]) for event in before.stream("rest") if "rest_s" in event]

    def compare(self, step: Step[Any, Any], place: PressPlace, press_mm_s: float) -> None:
        """Compare a step; raise BadInputError for another press or checkpoint, and list another note or rest.

        press_mm_s: speed of a press that names none.
        """
        with self._for_good():
            for press in place.ids:
                recorded, asked = self._recorded.get((press.purpose, press.index)), step.asked(place, press_mm_s)
                if recorded is not None and asked is not None:
                    _refuse_other(recorded, asked, _press(press.purpose, press.index))
            if isinstance(step, Checkpoint) and (was := self._other_text(step.verb, step.name)) is not None:
                raise _another_run(step.verb, repr(step.name), repr(was))
        if isinstance(step, Note) and (was := self._other_text(step.verb, step.text)) is not None:
            self.differences.append(_other(step.verb, step.text, was))
        known_s = self._rests_s or [getattr(step, "seconds", 0.0)]
        if isinstance(step, Rest) and not any(is_alike(step.seconds, was_s) for was_s in known_s):
            self.differences.append(_other(step.verb, step.seconds, known_s[0]))

    def _other_text(self, verb: str, text: str) -> str | None:
        """Return the text of the next step of a verb in the journal where it is another one."""
        if not self._texts[verb]:
            return None
        was = self._texts[verb].pop(0)
        return None if was == text else was


class SamePlan(_Comparison):
    """Steps that were planned when a run began, to be compared with those that its script plans now.

    Both plans give the script the predicted answers, so that only the script, or what it reads, can differ.
    """

    def __init__(self, planned: Sequence[Asked]) -> None:
        super().__init__()
        self._planned = [one for one in planned if one.get("verb") not in _REPORTED]
        self._reported = {
            verb: iter([one["what"] for one in planned if one.get("verb") == verb]) for verb in _REPORTED
        }
        self._n = 0

    def compare(self, asked: Asked) -> None:
        """Compare the next step; raise BadInputError for another one, and list another note or rest."""
        if asked.get("verb") in self._reported:
            was = next(self._reported[asked["verb"]], "none")
            if not is_alike(was, asked["what"]):
                self.differences.append(_other(asked["verb"], asked["what"], was))
            return
        with self._for_good():
            if self._n == len(self._planned):
                raise _another_run(_name(asked), _in_words(asked, [*asked]), "no further step")
            recorded, self._n = self._planned[self._n], self._n + 1
            if _name(asked) != _name(recorded):
                raise _another_run("next step", _name(asked), _name(recorded))
            _refuse_other(recorded, asked, _name(recorded))

    def end(self) -> None:
        """Raise BadInputError if a step differed or is missing, and list missing notes and rests."""
        super().end()
        if self._n < len(self._planned):
            raise _another_run("next step", "no further one", _name(self._planned[self._n]))
        for verb, left in self._reported.items():
            self.differences += [f"{verb}: none, where the run has {_said(was)}" for was in left]


def planned_step(step: Step[Any, Any], place: PressPlace, press_mm_s: float) -> Asked | None:
    """Return what is stored of a planned step, in types of JSON: all that moves or labels a press."""
    asked = step.asked(place, press_mm_s)
    if asked is None:
        return None
    first = place.ids[0] if place.ids else None
    numbers = {} if first is None else {"press": first.purpose, "index": first.index, "presses": len(place.ids)}
    return {**numbers, **{key: _plain(value) for key, value in asked.items()}}


def as_lines(steps: Iterable[Asked]) -> bytes:
    """Return planned steps as lines of JSON."""
    return "".join(f"{json.dumps(step)}\n" for step in steps).encode("ascii")


def read_plan(path: Path) -> SamePlan | None:
    """Return the plan that a run stored when it began; None for a run of an earlier version. Raises BadInputError."""
    try:
        return SamePlan(planned_steps(path))
    except FileNotFoundError:
        return None
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise BadInputError(
            f"{path}: not a plan of a run: {error}; put back an undamaged copy, or start a new run", "bad_plan"
        ) from None


def _recorded(before: Journalled) -> Iterator[tuple[tuple[Purpose, int], Asked]]:
    """Yield what each press in the journal was asked for; journals of 0.2 have neither verb, speed nor duration."""
    speeds_mm_s = {event["index"]: event["speed_mm_s"] for event in before.stream("ramp")}
    for purpose, stream in _STARTS.items():
        for event in before.stream(stream):
            asked = {key: value for key, value in event.items() if key not in _NOT_ASKED}
            if purpose == "data" and event["index"] in speeds_mm_s:
                asked |= {"verb": Ramp.verb, "speed_mm_s": speeds_mm_s[event["index"]]}
            yield (purpose, event["index"]), asked


def _other(verb: str, now: Any, was: Any) -> str:
    """Return in words how a note or a rest differs from that of the run."""
    return f"{verb}: {_said(now)}, where the run has {_said(was)}"


def _said(what: Any) -> str:
    """Return the text of a note or the duration of a rest in words."""
    return repr(what) if isinstance(what, str) else f"{what:g} s"


def _refuse_other(recorded: Asked, asked: Asked, name: str) -> None:
    # Earlier versions recorded the place in the schedule only in part.
    marks = ("block", "repeat", "condition") if "hold_s" in recorded else ()
    shared = [key for key in recorded if key in asked]
    keys = [key for key in dict.fromkeys((*shared, *marks)) if not is_alike(recorded.get(key), asked.get(key))]
    if keys:
        raise _another_run(name, _in_words(asked, keys), _in_words(recorded, keys))


def _another_run(name: str, asked: str, recorded: str) -> BadInputError:
    return BadInputError(
        f"{name}: the script now asks for {asked}, where the run has {recorded}, so it would be another run; restore "
        "the environment variables, files and modules that the script reads, or start a new run of a script that "
        "seeds what is random (random.Random(7).shuffle) and sorts what is a set",
        "another_press",
    )


def _name(step: Asked) -> str:
    return _press(step["press"], step["index"]) if "press" in step else f"{step['verb']}()"


def _press(purpose: str, index: int) -> str:
    return f"{purpose} press index {index}"


def _plain(value: Any) -> Any:
    """Return a number of any type as an int or a float; a position that no step has set is None."""
    if isinstance(value, Integral):
        return int(value)
    if isinstance(value, Real):
        return None if math.isnan(value) else float(value)
    return value


def _in_words(asked: Asked, keys: list[str]) -> str:
    values = {key: asked.get(key) for key in keys}
    return ", ".join(
        f"{key} = {one:g}" if isinstance(one, float) else f"{key} = {one}" for key, one in values.items()
    )
