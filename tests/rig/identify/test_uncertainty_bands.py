"""What relaxation leaves of a press, the band over likely fingers, and what references say of them."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import norm

import rig.plan.finger_model as finger_model
from rig.data import Run, RunFolder
from rig.plan.config import Config
from rig.plan.finger_model import Answers, band_of, remaining_shares
from rig.plan.finger_update import ReferenceForce, learned, references, updated_by
from rig.plan.plan import Plan
from rig.protocol.check import NoPredictionError
from rig.records import Pace, PlannedIndentation, Prediction, PredictionBand, Target
from sim.models.fingertip import Fingertip
from sim.models.relaxation import Memory, Prony, PronyTerm
from sim.units import GWT_N
from tests.error_codes import raises
from tests.rig.identify.finger_file import SERIES, identified_file

PACE = Pace(speed_mm_s=1.0, increment_mm=0.05, ramps=1, hold_s=1.0)


def test_a_ramp_takes_its_way_and_a_stop_each_increment() -> None:
    """The demo's journal: 0.15 s an increment of 0.05 mm at 1 mm/s."""
    assert PACE.ramp_s(1.0) == pytest.approx(1.0 + 20 * 0.1)
    assert PACE._replace(speed_mm_s=0.5).ramp_s(0.12) == pytest.approx(0.24 + 3 * 0.1)


def test_elastic_tissue_keeps_all() -> None:
    assert remaining_shares((), PACE, 1.0) == (1.0, 1.0)


@pytest.mark.parametrize("ramps", [1, 2, 3])
@pytest.mark.parametrize("doi_mm", [0.1, 1.0])
def test_what_is_left_is_that_of_the_series(ramps: int, doi_mm: float) -> None:
    """Against the exact step of `sim/models/relaxation.py` in 400 steps a ramp; 0.02 % is theirs."""
    pace = PACE._replace(ramps=ramps)
    prony = Prony([PronyTerm(*term) for term in SERIES])
    memory, felt = Memory.none(prony), 0.0
    steps, each_s = 400, pace.ramp_s(doi_mm) / ramps
    for k in range(ramps):
        for n in range(1, steps + 1):
            ahead = memory.ahead(each_s / steps)
            memory = memory.after(ahead, ((k + n / steps) / ramps) ** 1.5)
        hold = []
        for _ in range(steps):
            ahead = memory.ahead(pace.hold_s / steps)
            hold.append(ahead.stiffness * (memory.borne - ahead.carried))
            memory = memory.after(ahead, memory.borne)
        felt = float(np.mean(hold))
    assert remaining_shares(SERIES, pace, doi_mm).held == pytest.approx(felt, rel=3e-4)


def test_the_highest_is_on_the_quickest_way_there() -> None:
    left = remaining_shares(SERIES, PACE, 0.5)
    assert left.held < left.highest < 1.0
    assert left.highest == remaining_shares(SERIES, PACE._replace(ramps=4, hold_s=9.0), 0.5).highest
    assert remaining_shares(SERIES, PACE._replace(speed_mm_s=5.0), 0.5).highest > left.highest


def test_a_band_is_log_normal_and_has_the_models_error_in_it() -> None:
    ln = np.linspace(-0.1, 0.1, 8)
    found = Answers(4.0 * np.exp(ln), np.full(8, 0.5), 5.0 * np.exp(ln))
    identified = identified_file().identified
    force, doi, band = band_of(found, identified)
    half = norm.ppf(0.95) * np.hypot(ln.std(ddof=1), 0.02)
    assert (force, doi) == pytest.approx((4.0, 0.5))
    assert band.force_gwt == pytest.approx((4.0 * np.exp(-half), 4.0 * np.exp(half)))
    assert band.doi_mm == pytest.approx((0.5, 0.5))
    assert band.highest_gwt == pytest.approx(5.0 * np.exp(half))


def test_at_a_force_it_is_the_depth_that_has_a_band() -> None:
    ln = np.linspace(-0.1, 0.1, 8)
    force, doi, band = band_of(
        Answers(np.full(8, 4.0), 0.5 * np.exp(ln), np.full(8, 4.0)), identified_file().identified
    )
    half = norm.ppf(0.95) * np.hypot(ln.std(ddof=1), 0.02 / 1.5)
    assert (force, doi) == pytest.approx((4.0, 0.5))
    assert band.force_gwt == pytest.approx((4.0, 4.0))
    assert band.doi_mm == pytest.approx((0.5 * np.exp(-half), 0.5 * np.exp(half)))
    assert band.highest_gwt == pytest.approx(4.0)


@pytest.mark.parametrize("lost", [0, 1, 2, 3])
def test_likely_fingers_without_an_answer_are_named_with_their_press(
    lost: int, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Of eight: two may be left out."""
    held = 4.0 * np.exp(np.linspace(-0.1, 0.1, 8))
    held[:lost] = np.nan
    found = Prediction("bar:3.0", 0.75, Target("doi_mm", 0.5), -0.1, 4.0, 0.5, 4.0, 0.01)
    monkeypatch.setattr(finger_model, "answers", lambda *_: Answers(held, np.full(8, 0.5), 1.1 * held))
    press: Any = (None, found, None, PACE, identified_file().identified)
    if lost > 2:
        with raises(NoPredictionError, "likely_finger_not_converged", x_mm=0.75, value=0.5, lost=lost, fingers=8):
            finger_model._with_band(*press)
        return
    banded = finger_model._with_band(*press)
    assert banded.band is not None
    assert banded.predicted_force_gwt == pytest.approx(float(np.exp(np.log(held[lost:]).mean())))
    assert len(caplog.records) == (lost > 0)
    assert all("x = 0.75" in record.getMessage() for record in caplog.records)


def _planned(force_gwt: float, band: PredictionBand | None) -> PlannedIndentation:
    press = ("bar:3.0", 0.0, Target("doi_mm", 0.5), -0.1, force_gwt, 0.5, 4.0, 0.01)
    return PlannedIndentation(*press, band=band, increments=1, hold_s=1.0)


def test_limits_go_by_the_upper_end() -> None:
    band = PredictionBand((18.0, 24.0), (0.4, 0.6), 26.0)
    planned = _planned(20.0, band)
    assert (planned.highest_gwt, planned.deepest_mm) == (26.0, 0.6)
    assert planned.mean_pressure_kpa == pytest.approx(26.0 * GWT_N / 4.0 * 1000)
    plan = Plan()
    plan.presses["data"].append(planned)
    assert plan.peak_force_gwt == 26.0
    assert plan.soft_trip_n == pytest.approx(1.25 * 26.0 * GWT_N)
    plan.presses["reference"].append(_planned(20.0, None))  # as long as one press is none of it, twice
    assert plan.soft_trip_n == pytest.approx(2.0 * 26.0 * GWT_N)


def test_a_reference_moves_the_likely_fingers_as_bayes_has_it() -> None:
    """Of ln F = ln stiffness, so that the answer is that of two normal distributions."""
    identified = identified_file(spread=0.2).identified
    z = np.log([draw.stiffness for draw in identified.draw])
    noise = 0.02**2 + 1e-4
    seen = ReferenceForce("bar:3.0", 0.0, Target("doi_mm", 0.5), PACE, 0.3, 1e-4)
    after = updated_by(identified, z, seen)
    moved = np.log([draw.stiffness for draw in after.draw])
    prior = z.var(ddof=1)
    assert moved.mean() == pytest.approx(0.3 * prior / (prior + noise))
    assert moved.var(ddof=1) == pytest.approx(prior * noise / (prior + noise))
    fat = np.log([draw.e_fat for draw in after.draw])
    np.testing.assert_allclose(fat, np.log(0.1) - moved, atol=1e-12)  # it goes the other way, as it was drawn
    posterior = dict(zip(after.posterior.names, after.posterior.mean, strict=True))
    assert posterior["ln_stiffness"] == pytest.approx(moved.mean())
    assert posterior["x_mm"] == 0.1
    assert after.posterior.covariance[2] == identified.posterior.covariance[2]
    assert after.posterior.covariance[0][0] == pytest.approx(0.2**2 - prior**2 / (prior + noise))


def test_what_every_likely_finger_says_teaches_nothing() -> None:
    identified = identified_file().identified
    seen = ReferenceForce("bar:3.0", 0.0, Target("doi_mm", 0.5), PACE, 0.3, 1e-4)
    assert updated_by(identified, np.zeros(8), seen) == identified


def test_moduli_stay_where_fingers_are_interpolated() -> None:
    identified = identified_file(spread=0.2).identified
    z = np.log([draw.stiffness for draw in identified.draw])
    far = updated_by(identified, z, ReferenceForce("bar:3.0", 0.0, Target("doi_mm", 0.5), PACE, 9.0, 1e-4))
    assert {draw.e_fat for draw in far.draw} == {0.02}


def test_a_finger_that_stiffens_goes_on_to_and_one_that_does_not_never_begins() -> None:
    """However soft the reference says it is: the prior begins at 0.02."""
    z = np.linspace(-0.2, 0.2, 8)
    for stiffens, least in ((0.3, 0.02), (0.0, 0.0)):
        identified = identified_file(spread=0.2).identified
        draws = tuple(
            draw.model_copy(update={"stiffening": stiffens and stiffens + by})
            for draw, by in zip(identified.draw, z, strict=True)
        )
        identified = identified.model_copy(update={"draw": draws})
        far = updated_by(identified, z, ReferenceForce("bar:3.0", 0.0, Target("doi_mm", 0.5), PACE, -9.0, 1e-4))
        assert {draw.stiffening for draw in far.draw} == {least}
        near = updated_by(identified, z, ReferenceForce("bar:3.0", 0.0, Target("doi_mm", 0.5), PACE, 0.0, 1e-4))
        assert [draw.stiffening for draw in near.draw] == pytest.approx(8 * [stiffens], abs=0.05)


def test_without_references_a_run_teaches_nothing(tmp_path: Path, finger: Fingertip) -> None:
    folder = RunFolder(tmp_path)
    folder.config.write_text(identified_file().as_toml(), encoding="utf-8")
    assert learned(Run(folder, {"t_s": 0.0}, None, {}, {}, {}, 9.0, 9.0), finger) is None


def test_references_at_two_places_are_averaged_each_whatever_came_between() -> None:
    """Each place is one observation: the error of the model is counted once for it."""
    places = (-1.0, 1.0, -1.0, 1.0)
    starts = [
        {"index": k, "indentor": "bar:3.0", "x_mm": x, "target": "doi_mm", "value": 0.5, "increments": 1}
        for k, x in enumerate(places)
    ]
    hold = {"hold": 1, "force_gwt": 4.0, "force_sd_gwt": 0.1, "readings": 10, "asked_s": 1.0}
    ends = [{"index": k, **hold} for k in range(len(places))]
    events = {"reference_indentation_start": starts, "reference_hold_end": ends}
    run = Run(Path(), {"t_s": 0.0}, None, {}, events, {}, 9.0, 9.0)  # type: ignore[arg-type]
    found = references(run, Config())
    assert [one.x_mm for one in found] == [-1.0, 1.0]
    # of each place two holds: variance of the mean of ten readings, relative, and of the mean of two
    assert [one.variance for one in found] == pytest.approx(2 * [(0.1 / 4.0) ** 2 / 10 / 2])
