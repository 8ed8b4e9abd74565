"""Pulses for the recording amplifier at the events of a press."""

from rig.data.events import SyncEvent
from rig.devices.sync_line import SyncLineError, send_pulse
from rig.engine.engine import Engine
from rig.errors import TripError
from rig.records import PressId


def pulse(engine: Engine, press: PressId, at: str) -> None:
    """Send a pulse, if an output is configured, for presses that are data.

    The journal gets rise_s, when the line had confirmed the rise, and uncertainty_s, by how much earlier it may be.
    An output of the stage that fails stops the stage, as any failure of the stage. A lost adapter is an alarm, and
    gets no further pulse: the press continues, or lifts if limits.on_alarm is `trip`.
    """
    line, width_s = engine.sync_line, engine.settings.sync.width_s
    if line is None or press.purpose != "data":
        return
    try:
        sent = engine.guarded(lambda: send_pulse(line, engine.clock, width_s))
    except SyncLineError as lost:
        engine.sync_line = None
        engine.alarm(TripError(f"{lost}; presses have no sync pulse from here on", lost.code))
        return
    rise_s, uncertainty_s = round(engine.clock.run_s(sent.rise_s), 6), round(sent.uncertainty_s, 6)
    engine.record(SyncEvent(press.index, at, rise_s, uncertainty_s, round(sent.width_s, 6)), press)
