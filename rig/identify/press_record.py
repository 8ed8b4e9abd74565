"""A press as the journal has it, as the fit wants it."""

import math
import statistics
from dataclasses import replace
from typing import Any

import numpy as np

from rig.data.run import Events
from rig.settings import RigSettings
from rig.units import GWT_N
from sim.identification.predicted_forces import Given, PressTrajectory

_ABOVE_MM = 0.1  # over the first touch nothing is felt
_TOUCHES = 4  # of the readings just before contact was found
_HELD = 8  # of a hold, the closer the earlier
_DRIFT_GWT = 0.003  # between the air and the press
_ENOUGH = 8  # readings to tell their noise by
_DOWN = ("clearance", "approach", "touch")


def given_press(events: Events, index: int, settings: RigSettings) -> Given | None:
    """The press of a number; None where it has too little. Forces are counted from what was read in the air."""
    (start,) = _of_press(events, "indentation_start", index)
    samples, touches = (_of_press(events, stream, index) for stream in ("sample", "touch"))
    pressed, held = ([s for s in samples if s["phase"] == phase] for phase in ("press", "hold"))
    if not touches or len(pressed) + len(held) < 2:  # a soft finger may be touched as deep as it is to be pressed
        return None
    air = _in_the_air(samples, float(touches[-1]["contact_height_mm"]))
    noise = _noise_gwt(events, air)
    zero, zero_sd = _zero(air, noise)
    contact_mm = float(touches[-1]["contact_height_mm"])
    down = [s for s in samples if s["phase"] == "touch"] + pressed
    asked = [*down[-len(pressed) - _TOUCHES :], *_thinned(held)]
    given_mm = settings.calibration.value("compliance_mm_per_n", 0.0)
    way = PressTrajectory(
        start["indentor"],
        float(start["x_mm"]),
        np.array([s["t_s"] for s in down]),
        np.array([s["height_mm"] + _given_mm(s["force_gwt"], given_mm) for s in down]),
        np.array([s["t_s"] for s in asked]),
    )
    # The last sample is half a period old, and is on the wire for about as long.
    way = _as_felt(way, settings.force.latency_s + settings.force.sample_period_s)
    return Given(way, np.array([s["force_gwt"] for s in asked]) - zero, noise, zero_sd, zero, contact_mm)


def _as_felt(way: PressTrajectory, age_s: float) -> PressTrajectory:
    """The same, asked for when the readings were felt, none before the move that it came after had ended."""
    return replace(way, asked_s=np.maximum(way.asked_s - age_s, way.ended_s[way.lowest]))


def _of_press(events: Events, stream: str, index: int) -> list[dict[str, Any]]:
    return [event for event in events.get(stream, []) if event["index"] == index]


def _in_the_air(samples: list[dict[str, Any]], contact_mm: float) -> list[float]:
    """Forces read on the way down, with nothing touched."""
    above = [s for s in samples if s["phase"] in _DOWN and s["height_mm"] > contact_mm + _ABOVE_MM]
    return [s["force_gwt"] for s in above]


def _noise_gwt(events: Events, air: list[float]) -> float:
    """Of one reading: by those in the air, or the few at a zero."""
    if len(air) >= _ENOUGH:
        return statistics.stdev(air)
    return max((float(zero["noise_gwt"] or 0.0) for zero in events.get("zero", [])), default=0.0)


def _zero(air: list[float], noise_gwt: float) -> tuple[float, float]:
    """What is read in the air, and its sd."""
    if not air:
        return 0.0, math.hypot(noise_gwt, _DRIFT_GWT)
    return statistics.fmean(air), math.hypot(noise_gwt / math.sqrt(len(air)), _DRIFT_GWT)


def _thinned(held: list[dict[str, Any]]) -> list[dict[str, Any]]:
    if len(held) <= _HELD:
        return held
    return [held[k] for k in np.unique(np.geomspace(1, len(held), _HELD).round().astype(int) - 1)]


def _given_mm(force_gwt: float, mm_per_n: float) -> float:
    """How much higher the indentor is than the stage: what the rig gives."""
    return mm_per_n * max(force_gwt, 0.0) * GWT_N
