"""Presses from the journal, as input of the fit."""

import math
import statistics
from dataclasses import replace
from typing import Any

import numpy as np

from rig.data.run import Events
from rig.settings import RigSettings
from rig.units import GWT_N
from sim.identification.predicted_forces import MeasuredPress, PressTrajectory

_ABOVE_MM = 0.1  # above the first touch the sensor is in air
_TOUCHES = 4  # readings just before the contact was found
_HELD = 8  # readings of a hold, denser at its beginning
_DRIFT_GWT = 0.003  # sd of the zero between the air and the press
_ENOUGH = 8  # readings that suffice for a noise estimate
_DOWN = ("clearance", "approach", "touch")


def measured_press(events: Events, index: int, settings: RigSettings) -> MeasuredPress | None:
    """Return a press of the journal, forces minus their mean in air; None if it has too few readings."""
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
    used = [*down[-len(pressed) - _TOUCHES :], *_thinned(held)]
    mm_per_n = settings.calibration.value("compliance_mm_per_n", 0.0)
    trajectory = PressTrajectory(
        start["indentor"],
        float(start["x_mm"]),
        np.array([s["t_s"] for s in down]),
        np.array([s["height_mm"] + _deflection_mm(s["force_gwt"], mm_per_n) for s in down]),
        np.array([s["t_s"] for s in used]),
    )
    # The last sample is half a period old, and is on the wire for about as long.
    trajectory = _at_contact(trajectory, settings.force.latency_s + settings.force.sample_period_s)
    return MeasuredPress(
        trajectory, np.array([s["force_gwt"] for s in used]) - zero, noise, zero_sd, zero, contact_mm
    )


def _at_contact(trajectory: PressTrajectory, age_s: float) -> PressTrajectory:
    """Return the trajectory with reading times corrected for latency, but none before the end of its move."""
    return replace(trajectory, read_s=np.maximum(trajectory.read_s - age_s, trajectory.ended_s[trajectory.lowest]))


def _of_press(events: Events, stream: str, index: int) -> list[dict[str, Any]]:
    return [event for event in events.get(stream, []) if event["index"] == index]


def _in_the_air(samples: list[dict[str, Any]], contact_mm: float) -> list[float]:
    """Return the forces of the descent before the contact (gwt)."""
    above = [s for s in samples if s["phase"] in _DOWN and s["height_mm"] > contact_mm + _ABOVE_MM]
    return [s["force_gwt"] for s in above]


def _noise_gwt(events: Events, air: list[float]) -> float:
    """Return the noise of one reading, from those in air or at the zero (gwt)."""
    if len(air) >= _ENOUGH:
        return statistics.stdev(air)
    return max((float(zero["noise_gwt"] or 0.0) for zero in events.get("zero", [])), default=0.0)


def _zero(air: list[float], noise_gwt: float) -> tuple[float, float]:
    """Return the mean reading in air and its standard deviation (gwt)."""
    if not air:
        return 0.0, math.hypot(noise_gwt, _DRIFT_GWT)
    return statistics.fmean(air), math.hypot(noise_gwt / math.sqrt(len(air)), _DRIFT_GWT)


def _thinned(held: list[dict[str, Any]]) -> list[dict[str, Any]]:
    if len(held) <= _HELD:
        return held
    return [held[k] for k in np.unique(np.geomspace(1, len(held), _HELD).round().astype(int) - 1)]


def _deflection_mm(force_gwt: float, mm_per_n: float) -> float:
    """Return the height of the indentor above the position of the stage, from the compliance of the rig (mm)."""
    return mm_per_n * max(force_gwt, 0.0) * GWT_N
