"""One indentation: approach, touch off, press, hold, lift."""

import math

from rig.engine.engine import Engine
from rig.engine.errors import LimitError, NotReadyError
from rig.engine.pressing.approach import Approach
from rig.engine.pressing.press import Press
from rig.engine.records import Indentation, PressId, Target
from rig.engine.verbs import retract, safe_point, unpaused


def indent(
    engine: Engine,
    target: Target,
    *,
    increments: int = 1,
    speed_mm_s: float | None = None,
    hold_s: float = 1.0,
    expected_contact_mm: float = 0.0,
    contact_area_mm2: float = math.inf,
    press_id: PressId | None = None,
) -> Indentation:
    """Touch off at the present x, press in equal increments with a hold after each, end lifted to clearance.

    Contact is expected within limits.search_mm of expected_contact_mm (height from the nominal apex); none there, or
    one above, trips, since a dead or frozen sensor looks the same. Raises LimitError when the target is not
    reached within the deepest DOI allowed, or the finger has been touched for too long; the indentor is then lifted.
    contact_area_mm2 is what the pressure limit counts over. An indentation that the operator paused is done anew
    under the same press_id.
    """
    ready_to_indent(engine)
    press = PressId(engine.next_index()) if press_id is None else press_id
    speed = engine.settings.habits.press_speed_mm_s if speed_mm_s is None else speed_mm_s
    search_mm = engine.settings.limits.search_mm
    approach = Approach(engine, press, expected_contact_mm - search_mm, expected_contact_mm + search_mm)

    def attempt() -> Indentation:
        engine.trips.press_on(contact_area_mm2)
        return _attempt(engine, approach, target, increments, speed, hold_s)

    return unpaused(attempt)


def touch_place(engine: Engine, index: int, expected_contact_mm: float) -> float:
    """Touch off at the present place and lift; returns where contact was, height above the nominal apex, mm."""
    ready_to_indent(engine)
    search_mm = engine.settings.limits.search_mm
    approach = Approach(
        engine, PressId(index, "find"), expected_contact_mm - search_mm, expected_contact_mm + search_mm
    )
    try:
        height_mm = unpaused(lambda: approach.touch_off().contact_height_mm)
    except LimitError:
        retract(engine)
        raise
    retract(engine)
    engine.touched.at(engine.x_mm, engine.along_mm, height_mm)
    found = {"indentor": engine.indentor, "x_mm": engine.x_mm, "along_mm": engine.along_mm}
    engine.record("find", {"index": index, **found, "contact_height_mm": round(height_mm, 6)})
    return height_mm


def _attempt(
    engine: Engine, approach: Approach, target: Target, increments: int, speed_mm_s: float, hold_s: float
) -> Indentation:
    safe_point(engine)
    press, start_s = approach.press, engine.clock.monotonic_s()
    engine.record(
        press.stream("indentation_start"),
        {
            "index": press.index,
            "indentor": engine.indentor,
            "x_mm": engine.x_mm,
            "target": target.kind,
            "value": target.value,
            "increments": increments,
            **press.marks,
        },
    )
    try:
        touch = approach.touch_off()
        past_touch = Press(engine, press, touch, speed_mm_s)
        holds = tuple(
            past_touch.hold_at(target.part(k, increments), hold=k, hold_s=hold_s) for k in range(1, increments + 1)
        )
    except LimitError:
        retract(engine)
        raise
    retract(engine)
    engine.touched.at(engine.x_mm, engine.along_mm, touch.contact_height_mm)
    duration = engine.clock.monotonic_s() - start_s
    engine.record(press.stream("indentation_end"), {"index": press.index, "duration_s": round(duration, 6)})
    return Indentation(press.index, engine.x_mm, holds)


def ready_to_indent(engine: Engine) -> None:
    """Raise NotReadyError unless homed, zeroed, mounted, placed and clear."""
    engine.require_clear("indent")
    if engine.indentor is None:
        raise NotReadyError("indent: no indentor is mounted", code="no_indentor")
    if not engine.sensing.zeroed:
        raise NotReadyError("indent: the force sensor has not been zeroed", code="not_zeroed")
    if not engine.placed:
        raise NotReadyError("indent: the indentor has not been moved to a position since homing", code="not_placed")
    engine.contact.refuse_more()
