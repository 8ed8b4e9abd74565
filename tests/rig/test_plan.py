"""A plan and its predictions beside a finger that answers by F = k · d^1.5, worked out by hand; nothing is solved."""

import logging
import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from rig.engine.limits import RampBound, pressure_limit_gwt
from rig.errors import BadInputError
from rig.plan.config import Config
from rig.plan.finger_file import Draw, IdentifiedFinger
from rig.plan.finger_model import FingerModel, Predictions, remaining_shares
from rig.plan.plan import (
    Plan,
    Planner,
    PredictedBand,
    PredictionCheck,
    found,
    ramp_bound,
    refuse_fast_ramps,
    refuse_unseen,
)
from rig.plan.sample_age import SampleAge
from rig.protocol import Rig
from rig.protocol.api import ProtocolParameters
from rig.protocol.check import ForceTooDeepError, NoPredictionError, ScriptState
from rig.records import Pace, PlannedIndentation, Prediction, PredictionBand, PressId, Target
from rig.units import GWT_N
from sim.errors import ForceOutOfReachError
from sim.identification.uncertainty_bands import band
from sim.models.fingertip import Fingertip
from tests.error_codes import raises
from tests.rig.identify.finger_file import identified_file
from tests.rig.script_state import StandIn, ready

K_GWT = 10.0
PACE = Pace(1.0, 0.05, 2, 1.0)
SERIES = ((0.2, 0.07), (0.2, 1.4))
DEPTH, FORCE = Target("doi_mm", 0.5), Target("force_gwt", 4.0)


class LawFinger:
    """As much of a fingertip as a plan asks; `asked` keeps what it was asked."""

    apex_height_mm = 10.0

    def __init__(self, k_gwt: float = K_GWT, converged: bool = True, deepest_mm: float = 2.0) -> None:
        self.k_gwt, self.converged, self.deepest_mm = k_gwt, converged, deepest_mm
        self.config = Config().finger
        self.asked: list[Any] = []

    def indent(
        self, shape: object, x_mm: float, *, doi_mm: float | None = None, force_gwt: float | None = None
    ) -> SimpleNamespace:
        self.asked.append((x_mm, doi_mm, force_gwt))
        depth_mm = (force_gwt / self.k_gwt) ** (2 / 3) if doi_mm is None else doi_mm  # type: ignore[operator]
        if depth_mm > self.deepest_mm:
            raise ForceOutOfReachError("too soft", "force_out_of_reach")
        return SimpleNamespace(
            force_gwt=self.k_gwt * depth_mm**1.5, doi_mm=depth_mm, touch_height_mm=9.75, contact_area_mm2=12.5,
            peak_pressure_mpa=0.125, state=SimpleNamespace(converged=self.converged, residual=0.25),
        )  # fmt: skip

    def touch_height_mm(self, shape: object, x_mm: float, *, z_mm: float | None = None) -> float:
        return 9.5 if z_mm is None else 9.0 + z_mm


def _model(finger: LawFinger, kept: Predictions | None = None, identified: IdentifiedFinger | None = None) -> Any:
    return FingerModel(cast(Fingertip, finger), {} if kept is None else kept, identified=identified)


# --- the model ---


@pytest.mark.parametrize("target", [DEPTH, FORCE], ids=lambda target: target.kind)
def test_the_model_solves_each_press_once(target: Target) -> None:
    finger, kept = LawFinger(), dict[Any, Prediction]()
    model = _model(finger, kept)
    depth_mm = 0.5 if target is DEPTH else 0.4 ** (2 / 3)
    expected = Prediction(
        "bar:3.0", 0.25, target, -0.25, pytest.approx(10 * depth_mm**1.5), pytest.approx(depth_mm), 12.5, 0.125
    )
    for pace in (None, PACE, None):
        assert model.press("bar:3.0", 0.25, target, pace) == expected
    assert finger.asked == [(0.25, 0.5, None) if target is DEPTH else (0.25, None, 4.0)]
    assert list(kept) == [("bar:3.0", 0.25, target)]
    assert _model(LawFinger(k_gwt=99.0), kept).press("bar:3.0", 0.25, target) == expected


def test_a_press_that_the_model_cannot_solve_has_no_prediction() -> None:
    with raises(NoPredictionError, "not_converged", residual=0.25):
        _model(LawFinger(converged=False)).press("bar:3.0", 0.25, DEPTH)
    with raises(ForceTooDeepError, "force_out_of_reach"):
        _model(LawFinger(deepest_mm=0.1)).press("bar:3.0", 0.25, FORCE)


@pytest.mark.parametrize(("along_mm", "z_mm"), [(-1.5, 5.393), (0.0, 6.893), (1.5, 8.393)])
def test_positions_along_the_finger_count_from_the_receptor_plane_towards_the_tip(
    finger: Fingertip, along_mm: float, z_mm: float
) -> None:
    """The plane is 6.893 mm from the proximal end: 12.75 − 5.857."""
    height = FingerModel(finger, {}).touch_height_mm("sphere:2", 0.3, along_mm)
    apex = finger.touch_height_mm("sphere:2", 0.3, "apex")
    assert height == pytest.approx(finger.touch_height_mm("sphere:2", 0.3, z_mm=z_mm) - apex, abs=1e-9)


# --- the bands of an identified finger ---


def _identified(name: str, relaxation: Any = SERIES) -> IdentifiedFinger:
    """Eight likely fingers of stiffness 0.9 … 1.1; each name is one that nothing was remembered of."""
    found = identified_file(relaxation=relaxation).identified
    draws = tuple(
        Draw(stiffness=float(s), e_dermis=0.1, e_fat=0.1, relaxation=relaxation) for s in np.linspace(0.9, 1.1, 8)
    )
    return found.model_copy(update={"date": name, "draw": draws})


@pytest.fixture
def likely(monkeypatch: pytest.MonkeyPatch) -> list[LawFinger]:
    """The likely fingers, in their order, made for each configuration that is loaded."""
    made: list[LawFinger] = []

    class Loaded(LawFinger):
        def keeping_ways(self) -> LawFinger:
            return self

    def load(config: Any, *, exact: bool) -> LawFinger:
        assert not exact
        made.append(Loaded(K_GWT * config.tissue.stiffness))
        return made[-1]

    monkeypatch.setattr(Fingertip, "load", load)
    return made


def _law(depth_mm: float = 0.5) -> Any:
    return K_GWT * np.linspace(0.9, 1.1, 8) * depth_mm**1.5


def test_the_band_of_a_depth_press_is_that_of_the_relaxed_forces_of_likely_fingers(likely: list[LawFinger]) -> None:
    identified, kept = _identified("a depth"), dict[Any, Prediction]()
    model = _model(LawFinger(), kept, identified)
    assert model.press("bar:3.0", 0.25, DEPTH).band is None
    found = model.press("bar:3.0", 0.25, DEPTH, PACE)
    left = remaining_shares(SERIES, PACE, 0.5)
    assert 0.0 < left.held < left.highest < 1.0
    force, most = band(left.held * _law(), 0.02, 0.9), band(left.highest * _law(), 0.02, 0.9)
    assert found.predicted_force_gwt == pytest.approx(force.middle)
    assert found.band is not None
    assert found.band.force_gwt == pytest.approx((force.low, force.high))
    assert (found.predicted_doi_mm, found.band.doi_mm) == (pytest.approx(0.5), pytest.approx((0.5, 0.5)))
    assert found.band.highest_gwt == found.highest_gwt == pytest.approx(most.high)
    assert (found.contact_area_mm2, found.expected_contact_mm) == (12.5, -0.25)
    solved = [len(one.asked) for one in likely]
    assert model.press("bar:3.0", 0.25, DEPTH, PACE) is found
    assert [len(one.asked) for one in likely] == solved == [1] * 8
    slower = model.press("bar:3.0", 0.25, DEPTH, PACE._replace(speed_mm_s=0.01))
    assert slower.predicted_force_gwt < found.predicted_force_gwt
    assert list(kept)[1:] == [
        ("bar:3.0", 0.25, DEPTH, PACE),
        ("bar:3.0", 0.25, DEPTH, PACE._replace(speed_mm_s=0.01)),
    ]


@pytest.mark.parametrize("relaxation", [SERIES, ()], ids=["relaxes", "elastic"])
@pytest.mark.usefixtures("likely")
def test_the_band_of_a_force_press_is_that_of_the_depths_of_likely_fingers(relaxation: Any) -> None:
    """Where it relaxes it is pressed deeper; the pace is that of the depth of an elastic finger."""
    identified = _identified(f"a force {len(relaxation)}", relaxation)
    found = _model(LawFinger(), identified=identified).press("bar:3.0", 0.25, FORCE, PACE)
    stiff_gwt = K_GWT * np.linspace(0.9, 1.1, 8)
    elastic_mm = (4.0 / stiff_gwt) ** (2 / 3)
    held = np.array([remaining_shares(relaxation, PACE, float(mm)).held for mm in elastic_mm])
    depth = band((4.0 / held / stiff_gwt) ** (2 / 3), 0.02 / 1.5, 0.9)
    assert found.band is not None
    assert found.predicted_doi_mm == pytest.approx(depth.middle)
    assert found.band.doi_mm == pytest.approx((depth.low, depth.high))
    assert (found.predicted_force_gwt, found.band.force_gwt) == (pytest.approx(4.0), pytest.approx((4.0, 4.0)))
    assert found.band.highest_gwt == pytest.approx(4.0)


@pytest.mark.parametrize("target", [DEPTH, FORCE], ids=lambda target: target.kind)
@pytest.mark.parametrize("lost", [0, 2, 3])
def test_a_band_is_refused_if_more_than_a_quarter_of_the_likely_fingers_has_no_answer(
    target: Target, lost: int, likely: list[LawFinger], caplog: pytest.LogCaptureFixture
) -> None:
    identified = _identified(f"lost {lost} {target.kind}", ())
    model = _model(LawFinger(), identified=identified)
    model.press("bar:3.0", 0.0, target, PACE)  # loads them
    for one in likely[:lost]:
        one.converged = False
    caplog.set_level(logging.WARNING, "sim")
    if lost > 2:
        with raises(
            NoPredictionError, "likely_finger_not_converged", lost=3, fingers=8, indentor="bar:3.0", x_mm=0.25,
            value=target.value, target=target.kind,
        ):  # fmt: skip
            model.press("bar:3.0", 0.25, target, PACE)
        return
    found = model.press("bar:3.0", 0.25, target, PACE)
    if target is DEPTH:
        assert found.predicted_force_gwt == pytest.approx(band(_law()[lost:], 0.02, 0.9).middle)
    assert [record.args for record in caplog.records] == (
        [("bar:3.0", 0.25, target.kind, target.value, 2, 8)] if lost else []
    )


def test_a_force_beyond_one_likely_finger_has_no_prediction(likely: list[LawFinger]) -> None:
    model = _model(LawFinger(), identified=_identified("out of reach"))
    model.press("bar:3.0", 0.0, DEPTH, PACE)
    likely[5].deepest_mm = 0.1
    with raises(ForceTooDeepError, "force_out_of_reach", fingers=8):
        model.press("bar:3.0", 0.25, FORCE, PACE)


# --- the trip, and what would pass it ---


def planned(force_gwt: float = 4.0, doi_mm: float = 0.5, area_mm2: float = 40.0, **more: Any) -> PlannedIndentation:
    return PlannedIndentation(
        "bar", 0.25, Target("doi_mm", doi_mm), -0.3, force_gwt, doi_mm, area_mm2, 0.1,
        **{"increments": 1, "hold_s": 1.0, **more},
    )  # fmt: skip


def _plan(*presses: PlannedIndentation, **more: Any) -> Plan:
    plan = Plan(**more)
    plan.presses["data"].extend(presses)
    return plan


BANDED = PredictionBand((3.5, 4.5), (0.5, 0.5), 6.0)


@pytest.mark.parametrize(
    ("presses", "peak_gwt", "times"),
    [
        ([planned()], 4.0, 2.0),
        ([planned(), planned(5.0), planned(3.0)], 5.0, 2.0),
        ([planned(band=BANDED)], 6.0, 1.25),
        ([planned(band=BANDED), planned(5.0)], 6.0, 2.0),
        ([planned(1.0)], 1.0, 0.02 / GWT_N),
    ],
)
def test_the_soft_trip_is_twice_the_peak_or_a_quarter_above_the_band(
    presses: list[PlannedIndentation], peak_gwt: float, times: float
) -> None:
    plan = _plan(*presses)
    assert plan.peak_force_gwt == pytest.approx(peak_gwt)
    assert plan.soft_trip_n == pytest.approx(times * peak_gwt * GWT_N)
    assert _plan(*presses, first_soft_trip_n=0.75).soft_trip_n == 0.75


def test_the_planned_peak_force_counts_presses_of_every_purpose() -> None:
    plan = _plan(planned(3.0))
    assert (Plan().peak_force_gwt, Plan().indentations, Plan().all_presses) == (0.0, [], [])
    plan.presses["precondition"].append(planned(4.0))
    plan.presses["reference"].append(planned(5.0))
    assert [press.predicted_force_gwt for press in plan.all_presses] == [3.0, 4.0, 5.0]
    assert [press.predicted_force_gwt for press in plan.indentations] == [3.0]
    assert plan.peak_force_gwt == 5.0


@pytest.mark.parametrize(
    ("soft_trip_n", "area_mm2", "trip_gwt"),
    [
        (2.0, 400.0, 8.0),  # that of the plan
        (0.05, 400.0, 0.05 / GWT_N),
        (2.0, 0.25, pressure_limit_gwt(Config().limits.max_pressure_kpa, 0.25)),
    ],
)
def test_a_ramp_is_bound_by_the_lowest_trip_of_its_press(
    soft_trip_n: float, area_mm2: float, trip_gwt: float
) -> None:
    """And by the force at the upper end of its band, at its predicted depth."""
    config = Config.model_validate({"stage": {"kind": "zaber"}, "limits": {"soft_trip_n": soft_trip_n}})
    for banded in (None, replace(BANDED, highest_gwt=4.25)):
        ramp = planned(area_mm2=area_mm2, ramp_mm_s=0.2, band=banded)
        plan = _plan(ramp, first_soft_trip_n=8.0 * GWT_N)
        force_gwt = 4.0 if banded is None else 4.25
        of_ramp = ramp_bound(plan, config, ramp)
        assert of_ramp is not None
        expected = vars(RampBound.of(config, 0.2, trip_gwt, force_gwt, 0.5))
        assert vars(of_ramp) == pytest.approx(expected)
        assert ramp_bound(plan, config, planned(area_mm2=area_mm2, band=banded)) is None


def test_a_ramp_beyond_its_bound_is_refused_whatever_its_purpose() -> None:
    config = Config.model_validate({"stage": {"kind": "zaber"}})
    fast = planned(ramp_mm_s=5.0)
    for purpose in Plan().presses:
        plan = _plan()
        plan.presses[purpose].extend([planned(), fast])
        with raises(BadInputError, "ramp_too_fast", x_mm=0.25, speed_mm_s=5.0):
            refuse_fast_ramps(plan, config)


@pytest.mark.parametrize("ramp", [False, True])
def test_a_press_that_rises_past_the_trip_while_a_sample_ages_is_refused(ramp: bool) -> None:
    """A press by one increment at most; a ramp goes on. From 4 gwt to a trip of 8, by 12 gwt/mm."""
    config = Config.model_validate({"force": {"latency_s": 0.5}})
    age_s = SampleAge.of(config).age_s
    fastest_mm_s = 4.0 / (12.0 * age_s)

    def plan(speed_mm_s: float, force_gwt: float = 4.0) -> Plan:
        press = planned(force_gwt, ramp_mm_s=speed_mm_s if ramp else None)
        return _plan(press, first_soft_trip_n=8.0 * GWT_N, speeds_mm_s=[] if ramp else [(speed_mm_s, press)])

    refuse_unseen(plan(0.999 * fastest_mm_s), config)
    if not ramp:
        refuse_unseen(plan(1.001 * fastest_mm_s), config)  # 0.05 mm are 0.6 gwt
        with raises(BadInputError, "too_fast_for_sensor", rise_gwt=1.08, left_gwt=0.8):
            refuse_unseen(plan(fastest_mm_s, 7.2), config)
        return
    with raises(
        BadInputError,
        "too_fast_for_sensor",
        x_mm=0.25,
        age_s=age_s,
        limit_mm_s=fastest_mm_s,
        left_gwt=4,
        rise_gwt=4,
    ):
        refuse_unseen(plan(1.001 * fastest_mm_s), config)


# --- a script that is planned ---


def test_the_plan_of_a_script_holds_its_presses_touches_mounts_and_speeds() -> None:
    state, plan = ScriptState(Config(), StandIn()), Plan()
    rig = Rig(ProtocolParameters(), state, Planner(state, plan))
    ready(rig, 0.5)
    rig.indent(doi_mm=0.5, speed_mm_s=0.25)
    rig.indent(doi_mm=0.4)
    rig.ramp(doi_mm=0.3, speed_mm_s=0.2)
    rig.precondition(presses=2, doi_mm=0.2)
    rig.reference(x_mm=0.0, doi_mm=0.1)
    rig.move_to(x_mm=0.5)
    assert rig.touch() == -0.3
    rig.mount("step")
    press_mm_s = Config().habits.press_speed_mm_s
    assert [press.predicted_doi_mm for press in plan.indentations] == [0.5, 0.4, 0.3]
    assert [len(presses) for presses in plan.presses.values()] == [3, 2, 1]
    assert [(speed, press.predicted_doi_mm) for speed, press in plan.speeds_mm_s] == [
        (0.25, 0.5), (press_mm_s, 0.4), (press_mm_s, 0.3), (press_mm_s, 0.2), (press_mm_s, 0.1),
    ]  # fmt: skip
    assert [press.ramp_mm_s for press in plan.indentations] == [None, None, 0.2]
    assert [(one.press, one.contact_mm) for one in plan.touches] == [(PressId(0, "find"), -0.3)]
    assert plan.mounts == ["bar", "step"]


# --- promises of an identified finger ---


PROMISE = PredictedBand("data", 1, "force_gwt", 3.5, 4.0, 4.5)


@pytest.mark.parametrize(
    ("measured", "kept"), [(3.5, True), (4.5, True), (3.49, False), (4.51, False), (math.nan, False)]
)
def test_a_prediction_holds_up_to_the_ends_of_its_band(measured: float, kept: bool) -> None:
    assert PredictionCheck(PROMISE, "bar", 0.25, measured).kept is kept


def _run(promised: Any, **streams: Any) -> Any:
    return SimpleNamespace(start=promised, stream=lambda name: streams.get(name, []))


def test_a_prediction_is_compared_with_the_last_hold_of_a_finished_press() -> None:
    begun = [{"index": k, "indentor": "bar", "x_mm": 0.25, "increments": 2} for k in (0, 1, 2)]
    holds = [{"index": k, "force_gwt": 10.0 * k + n, "doi_mm": 0.1 * n} for k, n in ((0, 1), (1, 1), (1, 2))]
    both = {"indentation_start": begun, "hold_end": holds}
    start = {"promised": [{**vars(PROMISE), "index": k} for k in (0, 1, 2, 3)]}
    assert found(_run(start, **both)) == [PredictionCheck(PROMISE, "bar", 0.25, 12.0)]
    assert found(_run({}, **both)) == []
    for purpose in ("precondition", "reference"):
        promise = {**vars(PROMISE), "purpose": purpose, "key": "doi_mm"}
        streams = {f"{purpose}_{name}": events for name, events in both.items()}
        (one,) = found(_run({"promised": [promise]}, **streams))
        assert one == PredictionCheck(PredictedBand(**promise), "bar", 0.25, 0.2)
        assert found(_run({"promised": [promise]}, **both)) == []
