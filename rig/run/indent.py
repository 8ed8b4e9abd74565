"""One indentation: approach, touch off, press, hold, lift."""

import math

from rig.run.engine import Engine
from rig.run.errors import LimitError, PressPaused
from rig.run.press import Press
from rig.run.records import Indentation, Target


def indent(
    engine: Engine,
    target: Target,
    *,
    increments: int = 1,
    speed_mm_s: float | None = None,
    hold_s: float = 1.0,
    expected_contact_mm: float = 0.0,
    contact_area_mm2: float = math.inf,
    index: int | None = None,
) -> Indentation:
    """Touch off at the present x, press in equal increments with a hold after each, end lifted to clearance.

    Contact is expected within limits.search_mm of expected_contact_mm (height from the nominal apex); none there, or
    one above, trips, since a dead or frozen sensor looks the same. Raises LimitError when the target is not
    reached within the deepest DOI allowed; the indentor is then lifted. contact_area_mm2 is what the pressure limit
    counts over. An indentation that the operator paused is done anew under
    the same index, its number in the script.
    """
    engine.ready_to_indent()
    number = engine.next_index() if index is None else index
    speed = engine.settings.habits.press_speed_mm_s if speed_mm_s is None else speed_mm_s
    search_mm = engine.settings.limits.search_mm
    while True:
        try:
            engine.press_on(contact_area_mm2)
            press = Press(engine, number, speed, expected_contact_mm - search_mm, expected_contact_mm + search_mm)
            return _attempt(engine, press, target, increments, hold_s)
        except PressPaused:
            continue


def _attempt(engine: Engine, press: Press, target: Target, increments: int, hold_s: float) -> Indentation:
    engine.safe_point()
    index, start_s = press.index, engine.clock.monotonic_s()
    engine.record(
        "indentation_start",
        {
            "index": index,
            "indentor": engine.indentor,
            "x_mm": engine.x_mm,
            "target": target.kind,
            "value": target.value,
            "increments": increments,
        },
    )
    try:
        press.touch_off()
        holds = tuple(
            press.hold_at(target.part(k, increments), hold=k, hold_s=hold_s) for k in range(1, increments + 1)
        )
    except LimitError:
        engine.retract()
        raise
    engine.retract()
    duration = engine.clock.monotonic_s() - start_s
    engine.record("indentation_end", {"index": index, "duration_s": round(duration, 6)})
    return Indentation(index, engine.x_mm, holds)
