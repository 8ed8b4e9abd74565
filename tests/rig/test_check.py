"""`rig check`: what it says before anything moves, held against the dry-run that follows."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import rig.bench.virtual as devices
from rig.data import Run
from rig.engine import LimitError, TripError
from rig.plan.config import Config
from rig.plan.plan import make_plan
from rig.protocol.script import load_script
from rig.session.rehearsal_summary import Preflight, preflight
from rig.session.session import FinishedRun, NewRun, Session, dry_run
from rig.units import GWT_N
from sim.models.fingertip import Fingertip

NEAR = {"frame": {"pad_centre_x_mm": -12.0, "apex_z_mm": -12.0}}
"""A short way from the switches."""
PRESSES = """\
def run(rig):
    rig.mount("{indentor}")
    rig.home()
    rig.zero()
    for x_mm in {xs}:
        rig.move_to(x_mm=x_mm)
        rig.indent({how})
"""
BAR = {"indentor": "bar:3.0", "xs": (-0.5, 0.5), "how": "force_gwt=5.0, hold_s=1.0"}
DEEP = {"indentor": "cylinder:9", "xs": (0.0, 0.3), "how": "doi_mm=1.0, increments=3, hold_s=0.5"}
STEP = {"indentor": "step:1", "xs": (0.5, -0.68), "how": "force_gwt=8.0, hold_s=0.5"}


def _both(folder: Path, finger: Fingertip, what: dict[str, Any], **tables: Any) -> tuple[Preflight, FinishedRun]:
    path = folder / "mine.py"
    path.write_text(PRESSES.format(**what), encoding="utf-8")
    script, config = load_script(str(path)), Config.model_validate({**NEAR, **tables})
    plan = make_plan(script, config, finger)
    found = preflight(script, config, finger, plan)
    return found, dry_run(Session(script, config, finger, plan, NewRun(folder / "runs")))


def _peak_gwt(run: Run) -> float:
    return max(e["force_gwt"] for e in run.stream("sample"))


@pytest.mark.quick(rows=lambda what: what is not STEP)
@pytest.mark.parametrize("what", [BAR, DEEP, STEP], ids=["bar by force", "cylinder by depth", "step by force"])
def test_check_predicts_duration_and_peak_force_of_the_dry_run(
    finger: Fingertip, tmp_path: Path, what: dict[str, Any]
) -> None:
    """5 % of the duration, 2 % of the peak force: what was promised."""
    found, done = _both(tmp_path, finger, what)
    assert done.complete
    said = found.as_json()
    assert said["duration_s"] == pytest.approx(done.duration_s, rel=0.05)
    assert said["peak_force_gwt"] == pytest.approx(_peak_gwt(done.run), rel=0.02)


def test_a_stiffer_relaxing_finger_exceeds_the_predicted_peak_without_a_trip(
    finger: Fingertip, tmp_path: Path
) -> None:
    """By depth the force is off by the stiffness, less what relaxes; docs/validation/check.md states how much."""
    found, done = _both(
        tmp_path, finger, {**DEEP, "xs": (0.0,)}, virtual={"stiffness": 1.3, "relaxation": [[0.3, 1.0]]}
    )
    assert done.complete
    said, peak = found.as_json(), _peak_gwt(done.run)
    assert 1.0 < peak / said["peak_force_gwt"] < 1.3
    assert peak < found.trip_gwt
    assert said["duration_s"] == pytest.approx(done.duration_s, rel=0.05)


def test_a_finger_three_times_stiffer_than_predicted_trips_within_the_overshoot(
    finger: Fingertip, tmp_path: Path
) -> None:
    found, done = _both(tmp_path, finger, {**DEEP, "xs": (0.0,)}, virtual={"stiffness": 3.0})
    assert not done.complete
    assert done.problem is not None
    step = max(found.as_json()["steps"], key=lambda s: s["force_gwt"])
    assert _peak_gwt(done.run) <= found.trip_gwt + step["overshoot_gwt"]


def test_check_reports_mean_and_peak_pressure_in_kpa(finger: Fingertip, tmp_path: Path) -> None:
    """1 MPa = 1 N/mm² = 1000 kPa; the mean is the force over the area, the peak is the model's."""
    path = tmp_path / "mine.py"
    path.write_text(PRESSES.format(**DEEP), encoding="utf-8")
    script = load_script(str(path))
    said = preflight(script, Config(), finger, make_plan(script, Config(), finger)).as_json()
    for step in said["steps"]:
        pressed = finger.indent("cylinder:9", step["x_mm"], doi_mm=1.0)
        mean_mpa = pressed.force_n / pressed.contact_area_mm2
        assert step["peak_pressure_kpa"] == pytest.approx(1000 * pressed.peak_pressure_mpa, rel=1e-6)
        assert step["mean_pressure_kpa"] == pytest.approx(1000 * mean_mpa, rel=1e-6)
        assert step["peak_pressure_kpa"] > step["mean_pressure_kpa"]
    assert said["peak_pressure_kpa"] == max(step["peak_pressure_kpa"] for step in said["steps"])


# A share of 0.3 relaxes within a second, as long as a hold lasts.
ONCE = {**DEEP, "xs": (0.0,), "how": "doi_mm=1.0, hold_s=0.5"}
UNEXPECTED: dict[str, Any] = {"frame": {}, "virtual": {"stiffness": 1.3, "relaxation": [[0.3, 1.0]]}}


def _felt(folder: Path, finger: Fingertip, soft_trip_n: float) -> tuple[FinishedRun, float]:
    """A run on the unexpected finger, and what that truly felt at most, gwt: within trip and computed overshoot."""
    felt, cell = [0.0], devices.load_cell

    def seen(force_n: Callable[[float], float], **options: Any) -> Callable[[float], float]:
        def true_n(t_s: float) -> float:
            felt.append(force_n(t_s))
            return felt[-1]

        return cell(true_n, **options)

    folder.mkdir()
    limits = {"soft_trip_n": soft_trip_n}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(devices, "load_cell", seen)
        found, done = _both(folder, finger, ONCE, **UNEXPECTED, limits=limits)
    assert max(felt) / GWT_N <= found.trip_gwt + found.as_json()["overshoot_gwt"]
    return done, max(felt) / GWT_N


def test_no_trip_is_missed_on_a_finger_stiffer_than_predicted(finger: Fingertip, tmp_path: Path) -> None:
    """30 % stiffer, and it relaxes: no run goes on past its trip, wherever between said and read that is put.

    Just below the highest reading of a free run the steps get smaller before the trip, the finger relaxes meanwhile,
    and the depth may be reached after all: then no reading was above the trip.

    Between two readings a finger that relaxes feels a little more than either says: by a few per cent of what a
    share of 0.3 loses in the 50 ms to a reading, 1.5 %. A reading is known to half a step of the balance, 0.005 gwt.
    """
    free, most_gwt = _felt(tmp_path / "free", finger, 2.0)
    assert free.complete
    highest_gwt, predicted_n = _peak_gwt(free.run), finger.indent("cylinder:9", 0.0, doi_mm=1.0).force_n
    assert highest_gwt - 0.005 <= most_gwt <= 1.03 * highest_gwt
    assert highest_gwt > 1.03 * predicted_n / GWT_N
    completed = []
    for n, share in enumerate((0.9, 0.3, 0.1, 0.01, 0.001)):  # of the way from what was predicted to what is read
        trip_gwt = predicted_n / GWT_N + share * (highest_gwt - predicted_n / GWT_N)
        done, felt_gwt = _felt(tmp_path / str(n), finger, trip_gwt * GWT_N)
        assert felt_gwt <= 1.03 * trip_gwt
        if done.complete:
            assert _peak_gwt(done.run) <= trip_gwt
        else:
            assert isinstance(done.problem, TripError | LimitError)
            assert "soft_trip" in done.problem.code, done.problem
        completed.append(done.complete)
    assert not all(completed)


def test_check_accepts_a_press_of_a_few_micrometers(finger: Fingertip, tmp_path: Path) -> None:
    """At half of its depth no node is touched yet: there is no second point for a spring."""
    assert finger.indent("bar:3.0", -0.5, doi_mm=0.002).force_n == 0.0
    path = tmp_path / "mine.py"
    path.write_text(PRESSES.format(**{**BAR, "how": "doi_mm=0.004"}), encoding="utf-8")
    script = load_script(str(path))
    found = preflight(script, Config(), finger, make_plan(script, Config(), finger)).as_json()
    assert 0 < found["peak_force_gwt"] < 0.1
