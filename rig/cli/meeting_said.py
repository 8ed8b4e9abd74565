"""What `rig meet` says: before it begins, after each press, and at the end; and the forces that are asked for."""

from collections.abc import Sequence
from typing import Any

from rig.cli.output import err
from rig.plan.config import Config
from rig.plan.plan import make_plan
from rig.protocol.errors import BadInputError
from rig.protocol.script import load_script
from rig.session.meeting.meeting import DEPTHS_MM, PLACES_MM, Meeting, Told, Wanted
from rig.session.session import FinishedRun
from sim.models.fingertip import Fingertip
from sim.models.meeting.next_press import PressAt, Width

USUAL_GOALS = (
    *(PressAt("bar:3.0", x_mm, 0.67) for x_mm in (-1.0, 0.0, 1.0)),
    PressAt("cylinder:9", 0.0, 0.67),
    PressAt("sphere:4", 0.0, 0.5),
)

_BEYOND_X_MM, _BEYOND_DEPTH = 0.6, 1.1
_SECONDS_A_PRESS = 15.0


def goals_of(protocol: str | None, settings_of_it: Sequence[str], config: Config) -> tuple[PressAt, ...]:
    """The presses of a protocol, each once, as deep as the configured finger lets them go. Raises BadInputError."""
    if protocol is None:
        return USUAL_GOALS
    script = load_script(protocol, settings_of_it)
    plan = make_plan(script, config, Fingertip.load(config.finger))
    found = [PressAt(p.indentor, p.x_mm, round(p.predicted_doi_mm, 3)) for p in plan.indentations]
    if any("," in press.indentor and "across" in press.indentor for press in found):
        raise BadInputError(f"protocol {protocol}: presses across the finger cannot be foreseen yet")
    return tuple(dict.fromkeys(found))


def scope_of(wanted: Wanted) -> tuple[float, float]:
    """How far from the pad's centre and how deep forces are to be foreseen, mm."""
    places = [*map(abs, PLACES_MM), *(abs(goal.x_mm) for goal in wanted.goals)]
    depths = [*DEPTHS_MM, *(goal.doi_mm for goal in wanted.goals)]
    return max(places) + _BEYOND_X_MM, _BEYOND_DEPTH * max(depths)


def page_lines(config: Config, wanted: Wanted) -> dict[str, str]:
    """What is confirmed before anything real moves."""
    stage, force = config.stage, config.force
    return {
        "meeting": f"at most {wanted.presses} presses, none expected above {wanted.most_gwt:g} gwt, gentle first",
        "devices": f"{stage.kind} on {' and '.join(stage.ports)}, {force.kind} on {force.port}",
        "shapes": f"{', '.join(wanted.shapes)}: each is asked for when it is to be mounted",
        "duration": f"about {wanted.presses * _SECONDS_A_PRESS + 35:.0f} s, mounting aside",
        "safety": "is the emergency stop in reach, the finger clear of the indentor?",
    }


def said_after(meeting: Meeting, told: Told, *, as_json: bool) -> None:
    """One line: measured on foreseen with its band, what is known now, how much is left."""
    if as_json:
        return
    press, left = told.press, meeting.wanted.presses - told.number
    goes_on = "enough" if meeting.enough else f"at most {left} presses, {left * _SECONDS_A_PRESS:.0f} s left"
    err.print(
        f"press {told.number}: {press.indentor} at {press.x_mm:+.1f} mm to {press.doi_mm:.2f} mm, "
        f"{told.surprise.measured_gwt:.2f} gwt, foreseen {_banded(told.surprise.foreseen)}; "
        f"forces known to ± {100 * told.widest:.0f} % of ± {100 * meeting.wanted.width:g} %; "
        f"{goes_on}"
    )


def press_rows(meeting: Meeting) -> list[tuple[str, ...]]:
    """Of each press: what it was, what was foreseen before it, what was measured, what was known after it."""
    return [
        (
            f"{told.number}",
            told.press.indentor,
            f"{told.press.x_mm:+.1f}",
            f"{told.press.doi_mm:.2f}",
            _banded(told.surprise.foreseen),
            f"{told.surprise.measured_gwt:.2f}",
            f"± {100 * told.widest:.0f} %",
        )
        for told in meeting.told
    ]


def said_at_the_end(done: FinishedRun, meeting: Meeting, to: object) -> dict[str, Any]:
    """What was met, and what was not learned."""
    said: dict[str, Any] = {"run": str(done.folder.path), "presses": len(meeting.given)}
    if done.problem is not None and done.ending is not None:
        told = {about: words for about, words in done.ending.told.items() if about != "resume"}
        said |= {"ended": done.ending.reason} | told
    if meeting.given:
        prior, mean, sd = meeting.foreseen.prior, meeting.learned.mean, meeting.learned.draws.std(axis=0)
        learned = [f"{name} {m:+.3f} ± {s:.3f}" for name, m, s in zip(prior.names, mean, sd, strict=True)]
        forces = [
            f"{goal.indentor} at {goal.x_mm:+.1f} mm to {goal.doi_mm:.2f} mm: {_banded(w)}"
            for goal, w in zip(meeting.wanted.goals, meeting.widths, strict=True)
        ]
        said |= {"finger": str(to), "learned": learned, "forces": forces, "not learned": meeting.not_learned}
    return said | {"duration_s": round(done.duration_s, 1)}


def _banded(width: Width) -> str:
    return f"{width.middle:.2f} gwt ({width.low:.2f} … {width.high:.2f})"
