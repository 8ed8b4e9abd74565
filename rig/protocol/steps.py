"""What the steps that press have in common: what is refused, what the model expects, and the press itself."""

from dataclasses import dataclass

from rig.engine import Engine, Indentation, indent
from rig.engine.records import PressId, Target
from rig.errors import around
from rig.protocol.errors import BadInputError
from rig.protocol.planned import Pace, PlannedIndentation
from rig.protocol.refusals import (
    refuse_count,
    refuse_pressure,
    refuse_reach,
    refuse_seconds,
    refuse_speeds,
    refuse_target,
)
from rig.protocol.walk import ForceTooDeepError, NoPredictionError, Spot, Walk


@dataclass(frozen=True)
class ExpectedPresses:
    """The same press so many times at one place."""

    ids: tuple[PressId, ...]
    planned: PlannedIndentation


def check_press(
    verb: str, target: Target, walk: Walk, *, increments: int, hold_s: float, speed_mm_s: float | None = None
) -> None:
    """Refuse what needs no model to be refused."""
    walk.need_ready(verb)
    if walk.along_mm:
        raise BadInputError("{verb}: along_mm = {along_mm:g}: expected 0, elsewhere only touch()",
                            code="along_the_finger", verb=verb, along_mm=walk.along_mm)  # fmt: skip
    refuse_count(verb, "increments", increments)
    refuse_seconds(verb, "hold_s", hold_s)
    refuse_target(verb, target, walk.settings.limits)
    refuse_speeds(verb, speed_mm_s, walk.settings)


def expect_press(
    verb: str,
    target: Target,
    spot: Spot,
    walk: Walk,
    *,
    increments: int,
    hold_s: float,
    speed_mm_s: float | None = None,
) -> ExpectedPresses:
    """What the model says of it, within the limits."""
    habits = walk.settings.habits
    pace = Pace(speed_mm_s or habits.press_speed_mm_s, habits.increment_mm, increments, hold_s)
    try:
        found = walk.model.press(spot.indentor, spot.x_mm, target, pace)
    except ForceTooDeepError:
        raise BadInputError(
            "{verb}: {key} = {value:g} at x = {x_mm:g} mm is not reached at a DOI of limits.max_doi_mm = {high:g}",
            code="force_out_of_reach",
            verb=verb,
            key=target.kind,
            value=target.value,
            x_mm=spot.x_mm,
            high=walk.settings.limits.max_doi_mm,
        ) from None
    except NoPredictionError as error:
        raise around(BadInputError, "{verb}: {problem}", error, verb=verb) from None
    planned = PlannedIndentation(**vars(found), increments=increments, hold_s=hold_s)
    refuse_reach(verb, planned, walk.settings)
    refuse_pressure(verb, planned, walk.settings.limits)
    return ExpectedPresses(spot.ids, planned)


def press(
    engine: Engine, press_id: PressId, planned: PlannedIndentation, speed_mm_s: float | None = None
) -> Indentation:
    """Press as planned, where the indentor is."""
    return indent(
        engine,
        planned.target,
        increments=int(planned.increments),
        speed_mm_s=None if speed_mm_s is None else float(speed_mm_s),
        hold_s=float(planned.hold_s),
        expected_contact_mm=planned.expected_contact_mm,
        contact_area_mm2=planned.contact_area_mm2,
        press_id=press_id,
    )
