"""What `rig meet` says: before it begins, after each press, and at the end; and the forces that are asked for."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from rig.cli.output import err
from rig.devices.units import GWT_N
from rig.plan.config import Config
from rig.plan.plan import make_plan
from rig.protocol.errors import BadInputError
from rig.protocol.script import Script
from rig.session.meeting.meeting import BEYOND_DEPTH, DEPTHS_MM, PLACES_MM, Meeting, Told, Wanted
from rig.session.session import FinishedRun
from sim.contact.shapes import parse_shape
from sim.finger_process import Finger
from sim.identification.bands import Width, ends
from sim.identification.design import PressAt
from sim.identification.prior import named, plain

USUAL_GOALS = (
    *(PressAt("bar:3.0", x_mm, 0.67) for x_mm in (-1.0, 0.0, 1.0)),
    PressAt("cylinder:9", 0.0, 0.67),
    PressAt("sphere:6", 0.0, 0.5),
)

_BEYOND_X_MM = 0.6
_SECONDS_A_PRESS = 15.0


def usual_goals(shapes: Sequence[str]) -> tuple[PressAt, ...]:
    """A few common presses, of shapes that slope as those do that are pressed: each other kind wants a model more."""
    axes = {parse_shape(shape).axes for shape in shapes}
    return tuple(goal for goal in USUAL_GOALS if parse_shape(goal.indentor).axes in axes)


def goals_of(script: Script, config: Config, finger: Finger) -> tuple[PressAt, ...]:
    """The presses of a protocol, each once, as deep as the configured finger lets them go. Raises BadInputError."""
    plan = make_plan(script, config, finger)
    found = [PressAt(p.indentor, p.x_mm, round(p.predicted_doi_mm, 3)) for p in plan.indentations]
    if any("," in press.indentor and "across" in press.indentor for press in found):
        raise BadInputError(
            "protocol {protocol}: presses across the finger cannot be foreseen yet",
            code="not_foreseen", protocol=script.name,
        )  # fmt: skip
    return tuple(dict.fromkeys(found))


def scope_of(wanted: Wanted) -> tuple[float, float]:
    """How far from the pad's centre and how deep forces are to be foreseen, mm."""
    places = [*map(abs, PLACES_MM), *(abs(goal.x_mm) for goal in wanted.goals)]
    depths = [*DEPTHS_MM, *(goal.doi_mm for goal in wanted.goals)]
    return max(places) + _BEYOND_X_MM, BEYOND_DEPTH * max(depths)


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


def said_before(meeting: Meeting, press: PressAt | None) -> None:
    """One line on what begins now."""
    if press is None:
        err.print("homing, then the sensor's zero …")
        return
    where = f"{press.indentor} at {press.x_mm:+.1f} mm to {press.doi_mm:.2f} mm"
    trip_gwt = min(meeting.trip_n(press), meeting.settings.limits.soft_trip_n) / GWT_N
    err.print(
        f"press {len(meeting.told) + 1} of at most {meeting.wanted.presses}: {where}, trips at {trip_gwt:.1f} gwt …"
    )


def said_after(meeting: Meeting, told: Told) -> None:
    """One line: measured on foreseen with its band, what is known now, how much is left."""
    left = meeting.wanted.presses - told.number
    goes_on = "enough" if meeting.enough else f"at most {left} presses, {left * _SECONDS_A_PRESS:.0f} s left"
    foreseen = _in_brackets(told.surprise.foreseen, " gwt")
    err.print(
        f"press {told.number}: {told.surprise.measured_gwt:.2f} gwt, foreseen {foreseen}; "
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
            _in_brackets(told.surprise.foreseen),
            f"{told.surprise.measured_gwt:.2f}",
            f"± {100 * told.widest:.0f} %",
        )
        for told in meeting.told
    ]


def force_rows(meeting: Meeting) -> list[tuple[str, ...]]:
    """Of each force that was asked for: of which press, its band, how well it is known."""
    return [
        (goal.indentor, f"{goal.x_mm:+.1f}", f"{goal.doi_mm:.2f}", _in_brackets(w), f"± {100 * w.half:.0f} %")
        for goal, w in zip(meeting.wanted.goals, meeting.widths, strict=True)
    ]


def number_rows(meeting: Meeting) -> list[tuple[str, ...]]:
    """Of each parameter, as what it is of: the likeliest, and its bands after and before."""
    known = [np.quantile(one.draws, ends(), axis=0) for one in (meeting.learned, meeting.before)]
    return [
        (
            named(name),
            f"{plain(name, likeliest):.3g}",
            *(" … ".join(f"{plain(name, end):.3g}" for end in band[:, k]) for band in known),
        )
        for k, (name, likeliest) in enumerate(
            zip(meeting.learned.prior.names, meeting.learned.likeliest.tolist(), strict=True)
        )
    ]


def said_at_the_end(done: FinishedRun, meeting: Meeting, to: object) -> dict[str, Any]:
    """What was met, and what was not learned."""
    said: dict[str, Any] = {"run": str(done.folder.path), "presses": len(meeting.given)}
    if done.problem is not None and done.ending is not None:
        told = {about: words for about, words in done.ending.told.items() if about != "resume"}
        said |= {"ended": done.ending.reason} | told
    if meeting.learned.collapsed:
        said["collapsed"] = (
            f"too few draws explain these presses ({meeting.learned.effective:.1f} effective): "
            f"the bands mean nothing, and no command accepts {to}; repeat the identification"
        )
    if meeting.stranger is not None:
        said["no finger"] = f"{meeting.stranger}; was another indentor on than was asked for?"
    if meeting.given:
        learned = [f"{name} {likeliest} ({after})" for name, likeliest, after, _ in number_rows(meeting)]
        forces = [
            f"{goal.indentor} at {goal.x_mm:+.1f} mm to {goal.doi_mm:.2f} mm: {_in_brackets(w, ' gwt')}"
            for goal, w in zip(meeting.wanted.goals, meeting.widths, strict=True)
        ]
        said |= {"finger": str(to), "learned": learned, "forces": forces, "not learned": meeting.not_learned}
    return said | {"duration_s": round(done.duration_s, 1)}


def _in_brackets(width: Width, unit: str = "") -> str:
    return f"{width.middle:.2f}{unit} ({width.low:.2f} … {width.high:.2f})"
