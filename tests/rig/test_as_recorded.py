"""What the rig does, move by move, as it was when somebody last looked at it: speeds, waits, tolerances.

A change on purpose: delete the file under tests/data/as_recorded, run the test twice, and look at the difference.
"""

import math
from collections.abc import Callable, Mapping
from typing import Any

import pytest

from rig.engine import EngineError, Target, indent
from rig.engine.indentation import touch_place
from rig.engine.reference import measure_compliance
from rig.settings import RigSettings
from rig.units import GWT_N

Make = Callable[..., Any]
Recorded = Callable[[str, Any], None]


class Finger:
    """F = k d^1.5 that relaxes by a share in a time, felt with a wobble by a cell of so many gwt a step."""

    def __init__(self, bench: Any, relaxes: float, in_s: float, wobble_gwt: float) -> None:
        self.bench, self.relaxes, self.in_s, self.wobble_gwt = bench, relaxes, in_s, wobble_gwt
        self.touched_s: float | None = None
        self.frozen_from_gwt = math.inf
        self.felt = 0.0

    def force_n(self, t_s: float) -> float:
        height = self.bench.board.carriage_steps_at(t_s)[2] / 400 - self.bench.settings.frame.apex_z_mm
        depth = self.bench.contact_mm - height
        if depth <= 0:
            self.touched_s = None
            return self.wobble_gwt * math.sin(1e3 * t_s) * GWT_N
        self.touched_s = t_s if self.touched_s is None else self.touched_s
        left = 1 - self.relaxes * (1 - math.exp(-(t_s - self.touched_s) / self.in_s))
        gwt = self.bench.k_gwt * depth**1.5 * left + self.wobble_gwt * math.sin(1e3 * t_s)
        if self.felt < self.frozen_from_gwt:
            self.felt = gwt
        return self.felt * GWT_N


SCENES: dict[str, dict[str, Any]] = {
    "to a depth": {"target": ("doi_mm", 0.9), "increments": 2},
    "to a depth, fast": {"target": ("doi_mm", 1.2), "speed_mm_s": 3.0},
    "to a depth on a rig that gives": {
        "target": ("doi_mm", 0.6), "k_gwt": 40.0,
        "settings": {"calibration": {"compliance_mm_per_n": {
            "value": 0.3, "sd": 0.02, "date": "2026-01-01", "expires": "2027-01-01"}}},
    },
    "to a small force": {"target": ("force_gwt", 0.5), "k_gwt": 1.5},
    "to a force in increments": {"target": ("force_gwt", 8.0), "increments": 3},
    "to a large force": {"target": ("force_gwt", 40.0), "k_gwt": 30.0},
    "to a force by coarse steps": {
        "target": ("force_gwt", 2.33), "k_gwt": 2.0, "settings": {"stage": {"resolution_mm": 0.02}}},
    "to a force that one step passes over": {
        "target": ("force_gwt", 2.33), "k_gwt": 100.0, "settings": {"stage": {"resolution_mm": 0.02}}},
    "a force that is felt with noise": {"target": ("force_gwt", 2.33), "wobble_gwt": 0.03, "hold_s": 2.0},
    "a force that relaxes": {"target": ("force_gwt", 8.0), "k_gwt": 14.0, "relaxes": 0.4, "in_s": 0.7,
        "hold_s": 3.0},
    "a force that relaxes under noise": {
        "target": ("force_gwt", 12.0), "k_gwt": 30.0, "relaxes": 0.5, "in_s": 4.0,
        "hold_s": 4.0, "wobble_gwt": 0.05},
    "a force that relaxes, by a late and coarse cell": {
        "target": ("force_gwt", 5.0), "relaxes": 0.3, "in_s": 1.0, "hold_s": 2.0,
        "settings": {"force": {"latency_s": 0.08, "resolution_gwt": 0.1}, "habits": {"settle_readings": 2}}},
    "no finger": {"target": ("doi_mm", 0.5), "contact_mm": -3.0},
    "a finger too high": {"target": ("doi_mm", 0.5), "contact_mm": 0.9},
    "a finger too soft": {"target": ("force_gwt", 20.0), "k_gwt": 2.0},
    "a finger too stiff for the soft trip": {"target": ("doi_mm", 1.0), "k_gwt": 60.0, "soft_trip_n": 0.3},
    "a finger as hard as a table": {"target": ("doi_mm", 1.0), "k_gwt": 4000.0},
    "a reading that freezes": {"target": ("doi_mm", 1.4), "frozen_from_gwt": 1.0},
    "a reading that freezes late": {"target": ("force_gwt", 30.0), "k_gwt": 20.0, "frozen_from_gwt": 9.0},
    "a pressure too high": {"target": ("doi_mm", 1.0), "contact_area_mm2": 0.1},
}  # fmt: skip


def _bench(spring: Make, scene: Mapping[str, Any]) -> Any:
    settings = RigSettings.model_validate(scene.get("settings", {}))
    given = {key: scene[key] for key in ("k_gwt", "contact_mm", "soft_trip_n") if key in scene}
    bench = spring(settings=settings, **given)
    finger = Finger(bench, scene.get("relaxes", 0.0), scene.get("in_s", 1.0), scene.get("wobble_gwt", 0.0))
    finger.frozen_from_gwt = scene.get("frozen_from_gwt", math.inf)
    bench.force_n = finger.force_n
    return bench


def _said(bench: Any, problem: str) -> dict[str, Any]:
    """Moves with their times, all events but the readings, how many of these in each phase, and what went wrong."""
    sent = bench.confirmed()
    moves = [[round(move.t_s - sent[0].t_s, 6), move.target_mm, move.feed] for move in sent]
    phases: dict[str, int] = {}
    for sample in bench.of("sample"):
        phases[sample["phase"]] = phases.get(sample["phase"], 0) + 1
    events = [[stream, data] for stream, data in bench.events if stream != "sample"]
    return {"moves": moves, "events": events, "readings": phases, "problem": problem}


@pytest.mark.parametrize("name", SCENES)
def test_an_indentation(spring: Make, recorded: Recorded, name: str) -> None:
    scene = SCENES[name]
    bench = _bench(spring, scene)
    kind, value = scene["target"]
    options = {key: scene[key] for key in ("increments", "speed_mm_s", "hold_s", "contact_area_mm2") if key in scene}
    problem = ""
    try:
        indent(bench.ready(), Target(kind, value), **{"hold_s": 0.3, **options})
    except EngineError as error:
        problem = f"{type(error).__name__}: {error}"
    recorded(name, _said(bench, problem))


def test_a_touch_to_find_the_finger(spring: Make, recorded: Recorded) -> None:
    bench = _bench(spring, {"wobble_gwt": 0.01})
    touch_place(bench.ready(0.7), 3, -0.2)
    recorded("a touch to find the finger", _said(bench, ""))


def test_the_compliance_of_the_rig(spring: Make, recorded: Recorded) -> None:
    bench = _bench(spring, {"k_gwt": 400.0, "contact_mm": 0.1, "wobble_gwt": 0.02})
    found = measure_compliance(bench.ready(), 20.0)
    recorded("the compliance of the rig", {**_said(bench, ""), "found": vars(found)})
