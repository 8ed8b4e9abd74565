"""The pulse that tells a recording amplifier what is happening."""

from rig.engine.engine import Engine
from rig.engine.records import PressId


def pulse(engine: Engine, press: PressId, at: str) -> None:
    """Say that this is the instant, where an output is configured; of data only.

    rise_s is when the device had confirmed the rise, uncertainty_s how long before that it may have been.
    """
    sync, clock, stage = engine.settings.sync, engine.clock, engine.bench.stage
    if sync.output == "off" or press.purpose != "data":
        return
    asked_s = clock.monotonic_s()
    engine.guarded(lambda: stage.set_output(True))
    rise_s = clock.monotonic_s()
    clock.wait_s(sync.width_s)
    engine.guarded(lambda: stage.set_output(False))
    width_s = clock.monotonic_s() - rise_s
    engine.record(
        "sync",
        {
            "index": press.index,
            "at": at,
            "rise_s": round(rise_s, 6),
            "uncertainty_s": round(rise_s - asked_s, 6),
            "width_s": round(width_s, 6),
        },
    )
