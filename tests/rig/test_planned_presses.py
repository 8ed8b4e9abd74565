"""Presses as the plan foresees them, and every verb as the engine carries it out beside a spring."""

import math
from collections.abc import Callable
from typing import Any

import pytest

from rig.engine import EngineError
from rig.protocol import Rig
from rig.protocol.api import ProtocolParameters
from rig.protocol.check import PressPlace, ScriptState
from rig.protocol.steps import (
    ExpectedPresses,
    Precondition,
    Reference,
)
from rig.records import (
    Hold,
    Indentation,
    Pace,
    PlannedIndentation,
    Prediction,
    PredictionBand,
    PressId,
    Target,
)
from rig.session.execute import Live, execute
from tests.error_codes import shows
from tests.rig.script_state import StandIn, Walked, ready, walked

Make = Callable[..., Any]


def _from_ready(script: Callable[[Rig], object]) -> Walked:
    """What a script hands on from where everything is ready."""

    def whole(rig: Rig) -> None:
        script(ready(rig))

    found = walked(whole)
    del found.expected[:4], found.answers[:4]
    return found


# --- what the plan expects and answers ---


def test_an_indentation_in_increments_is_predicted_in_equal_parts() -> None:
    """10 gwt/mm: 0.5, 1 and 1.5 mm; a force that is foreseen does not scatter."""
    found = _from_ready(lambda rig: rig.indent(force_gwt=15.0, increments=3, hold_s=0.25))
    parts = [(5.0, 0.5), (10.0, 1.0), (15.0, 1.5)]
    holds = tuple(Hold(Target("force_gwt", gwt), mm, gwt, 0.0) for gwt, mm in parts)
    assert found.answers == [Indentation(0, 0.0, holds)]
    target = Target("force_gwt", 15.0)
    (expected,) = found.expected
    assert expected.ids == (PressId(0),)
    assert expected.planned == PlannedIndentation(
        "bar", 0.0, target, -0.3, 15.0, 1.5, 40.0, 0.1, increments=3, hold_s=0.25
    )


PACES: dict[str, tuple[Callable[[Rig], object], Pace]] = {
    "indent": (lambda rig: rig.indent(doi_mm=0.5), Pace(1.0, 0.05, 1, 1.0)),
    "indent otherwise": (
        lambda rig: rig.indent(doi_mm=0.5, increments=2, speed_mm_s=0.3, hold_s=0.25), Pace(0.3, 0.05, 2, 0.25),
    ),
    "ramp": (lambda rig: rig.ramp(doi_mm=0.5, speed_mm_s=0.3, hold_s=0.25), Pace(0.3, math.inf, 1, 0.25)),
    "precondition": (lambda rig: rig.precondition(presses=3, doi_mm=0.5, hold_s=0.25), Pace(1.0, 0.05, 1, 0.25)),
    "reference": (
        lambda rig: rig.reference(x_mm=0.5, doi_mm=0.3, increments=4, hold_s=0.25), Pace(1.0, 0.05, 4, 0.25),
    ),
}  # fmt: skip


@pytest.mark.parametrize("verb", PACES)
def test_the_model_predicts_each_press_at_its_speed_increments_and_hold(verb: str) -> None:
    """Tissue that relaxes pushes harder the faster it is pressed. By the usual 1 mm/s and 0.05 mm."""
    script, pace = PACES[verb]
    asked: list[Pace | None] = []

    class Paced(StandIn):
        def press(self, indentor: str, x_mm: float, target: Target, pace: Pace | None = None) -> Prediction:
            asked.append(pace)
            return super().press(indentor, x_mm, target, pace)

    (*_, expected) = walked(lambda rig: script(ready(rig)), Paced(), stage={"kind": "zaber"}).expected
    assert asked == [pace]
    assert (expected.planned.increments, expected.planned.hold_s) == (pace.ramps, pace.hold_s)


# --- what the engine does: a spring of k · DOI^1.5 that is touched 0.9 mm below the nominal apex ---

DEEP_MM = -0.9


def _live(bench: Any, finger: StandIn) -> tuple[Rig, Live, ScriptState]:
    state = ScriptState(bench.settings, finger)
    live = Live(bench.engine, state)
    return Rig(ProtocolParameters(), state, live), live, state


def test_a_live_script_carries_out_every_verb(spring: Make) -> None:
    """Contact lies 0.9 mm down, 0.4 mm further than it would be looked for without the model."""
    bench = spring(contact_mm=DEEP_MM)
    rig, _, _ = _live(bench, StandIn(contact_mm=DEEP_MM))
    rig.note("begun")
    rig.mount("bar")
    rig.home()
    rig.zero()
    rig.checkpoint("zeroed")
    rig.move_to(x_mm=1, along_mm=-2)
    touched_mm = rig.touch()
    rig.move_to(x_mm=1)
    rig.precondition(presses=2, doi_mm=0.2, hold_s=0.1)
    rig.reference(x_mm=-1, doi_mm=0.2, hold_s=0.1)
    found = rig.indent(doi_mm=0.3, increments=2, hold_s=0.1)
    rig.rest(2)
    rig.retract()

    assert [data["text"] for data in bench.of("note")] == ["begun"]
    assert bench.mounted == "bar"
    assert len(bench.of("home")) == len(bench.of("zero")) == 1
    assert [data["name"] for data in bench.of("checkpoint")] == ["zeroed"]
    assert [(e["x_mm"], e["along_mm"]) for e in bench.of("move")] == [(1.0, -2.0), (1.0, 0.0), (-1.0, 0.0)]
    assert touched_mm == pytest.approx(DEEP_MM, abs=0.01)
    assert [e["index"] for e in bench.of("find")] == [0]
    assert [(e["index"], e["x_mm"]) for e in bench.of("precondition_hold_end")] == [(0, 1.0), (1, 1.0)]
    assert [(e["index"], e["hold"], e["x_mm"]) for e in bench.of("reference_hold_end")] == [
        (0, 1, -1.0),
        (0, 2, -1.0),
    ]
    assert [e["index"] for e in bench.of("reference")] == [0]
    assert [(e["index"], e["commanded"], e["asked_s"]) for e in bench.of("hold_end")] == [
        (0, 0.15, 0.1),
        (0, 0.3, 0.1),
    ]
    assert (found.index, found.x_mm) == (0, -1.0)
    assert [hold.target for hold in found.holds] == [Target("doi_mm", 0.15), Target("doi_mm", 0.3)]
    assert [data["rest_s"] for data in bench.of("rest")] == [2.0]
    assert [stream for stream, _ in bench.events][-1] == "retract"


def test_a_press_is_limited_over_the_area_that_the_model_expects(spring: Make) -> None:
    """25 gwt at 0.3 mm are short of every other limit, but 300 kPa over 0.1 mm² are 3 gwt."""
    bench = spring(k_gwt=150.0)
    rig, _, _ = _live(bench, StandIn(gwt_mm=1.0, area_mm2=0.1))
    with pytest.raises(EngineError) as ended:
        ready(rig).indent(doi_mm=0.3, hold_s=0.0)
    assert ended.value.code in ("pressure_limit", "next_move_past_pressure_limit")
    assert shows(str(ended.value), 0.03 / 9.80665e-3)
    assert not bench.of("hold_end")


def test_a_resumed_run_makes_missing_presses_at_the_place_the_script_had(spring: Make) -> None:
    """The move that is owed may be a later one, to another place."""
    bench = spring()
    rig, live, state = _live(bench, StandIn())
    ready(rig, 0.5)
    owed = PressPlace("bar", -0.5, 0.0, (PressId(3, "precondition"),))
    live.handle(Precondition(presses=1, doi_mm=0.2, hold_s=0.1), owed)
    assert [(e["index"], e["x_mm"]) for e in bench.of("precondition_hold_end")] == [(3, -0.5)]
    state.x_mm = 0.5
    owed = PressPlace("bar", 1.0, 0.0, (PressId(1, "reference"),))
    live.handle(Reference(x_mm=1.0, doi_mm=0.2, increments=1, hold_s=0.1), owed)
    assert [(e["index"], e["x_mm"]) for e in bench.of("reference_hold_end")] == [(1, 1.0)]
    assert [e["index"] for e in bench.of("reference")] == [1]


@pytest.mark.parametrize(("band_gwt", "alarms"), [((0.1, 10.0), 0), ((4.0, 6.0), 1)])
def test_a_reference_press_outside_the_band_of_an_identified_finger_alarms(
    spring: Make, band_gwt: tuple[float, float], alarms: int
) -> None:
    """0.5 gwt at 0.2 mm."""
    bench = spring()
    planned = PlannedIndentation(
        "bar:3.0", 0.0, Target("doi_mm", 0.2), -0.3, 0.5, 0.2, 40.0, 0.1, increments=1, hold_s=0.1,
        band=PredictionBand(band_gwt, (0.1, 0.3), 7.0),
    )  # fmt: skip
    expected = ExpectedPresses((PressId(0, "reference"),), planned)
    execute(bench.ready(), Reference(x_mm=0.0, doi_mm=0.2), expected)
    assert len(bench.of("alarm")) == alarms
