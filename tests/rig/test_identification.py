"""An identification over the bytes of the virtual bench with made-up fingers: its presses, messages and files."""

import math
import shutil
from copy import copy
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import rig.identify.adaptive_presses as course
from rig.bench.virtual import bench_around
from rig.cli.identify_finger import (
    possible,
    usual_goals,
)
from rig.data import RunFolder, read_run
from rig.data.folder import IDENTIFICATION_PAGE
from rig.errors import BadInputError, LimitError, TripError
from rig.identify.adaptive_presses import Identification, IdentificationOptions, with_reliable_touch
from rig.identify.finger_from_presses import finger_file
from rig.identify.identification_script import IdentificationScript
from rig.identify.press_record import measured_press
from rig.identify.random_finger import CELL_NOISE_GWT, truth_of, with_random_finger
from rig.plan.config import Config, VirtualSettings
from rig.plan.finger_file import read_finger_file
from rig.plan.plan import Plan
from rig.protocol.api import Rig
from rig.session.session import FinishedRun, NewRun, NoAttendant, Session, run_on
from rig.units import GWT_N
from sim.carriage import Carriage, TruePose
from sim.devices.clock import VirtualClock
from sim.identification.next_press import PressAt
from sim.identification.predicted_forces import MeasuredPress, PressTrajectory
from sim.identification.prior import TAU_FAST_S, Prior
from sim.identification.uncertainty_bands import standard_deviations
from sim.models.fingertip import Fingertip
from sim.models.relaxation import Memory, Prony, PronyTerm
from tests.error_codes import raises
from tests.made_up_fingers import made_up
from tests.program import Program

FORESEEN = made_up()
GOALS = (PressAt("cylinder:9", 0.5, 0.67), PressAt("bar:3.0", 0.0, 0.5))
RELAXES = ("share_fast", "share_slow", "ln_tau_slow_s")
SETTINGS = with_reliable_touch(Config(virtual=VirtualSettings(cell_noise_gwt=0.01)))


class MadeUpPlant:
    """A made-up finger under a carriage; from a force on it may answer four times as hard."""

    def __init__(self, carriage: Carriage, draw: np.ndarray, most_gwt: float = math.inf) -> None:
        self._carriage, self._draw, self._most_gwt = carriage, draw[None], most_gwt
        fast, slow, ln_tau = (float(draw[FORESEEN.prior.index(name)]) for name in RELAXES)
        self._prony = Prony([PronyTerm(fast, TAU_FAST_S), PronyTerm(slow, math.exp(ln_tau))])
        self._indentor, self._memory, self._felt = "", Memory.none(self._prony), (0.0, 0.0)

    def mount(self, indentor: str) -> None:
        self._indentor, self._memory = indentor, Memory.none(self._prony)

    def pose_at(self, t_s: float) -> TruePose:
        pose = self._carriage.pose_at(t_s)
        return TruePose(pose.x_mm, pose.above_apex_mm, -pose.above_apex_mm)

    def force_n(self, t_s: float) -> float:
        """Once an instant; they come in their order."""
        if t_s > self._felt[0]:
            ahead, elastic_gwt = self._memory.ahead(t_s - self._felt[0]), self._elastic_gwt(t_s)
            self._memory = self._memory.after(ahead, elastic_gwt)
            self._felt = t_s, max(ahead.stiffness * (elastic_gwt - float(ahead.carried)), 0.0)
        return self._felt[1] * GWT_N

    def _elastic_gwt(self, t_s: float) -> float:
        pose, once = self._carriage.pose_at(t_s), np.zeros(1)
        if not self._indentor or pose.above_apex_mm > 1:
            return 0.0
        way = PressTrajectory(self._indentor, pose.x_mm, once, np.array([pose.above_apex_mm]), once)
        force_gwt = float(FORESEEN.elastic_gwt(self._draw, way)[0, 0])
        return force_gwt if force_gwt < self._most_gwt else 4 * force_gwt


class Reader(NoAttendant):
    def __init__(self, script: IdentificationScript) -> None:
        self._script = script

    def begins(self, folder: RunFolder) -> None:
        self._script.begins(folder)


def _truth(seed: int) -> np.ndarray:
    return FORESEEN.prior.draws(1, np.random.default_rng(seed))[0]


def _identify(
    tmp_path: Path,
    finger: Fingertip,
    truth: np.ndarray,
    options: IdentificationOptions | None = None,
    most_gwt: float = math.inf,
) -> tuple[Identification, FinishedRun]:
    identification = Identification(SETTINGS, FORESEEN, options or IdentificationOptions(GOALS, presses=5))
    script = IdentificationScript(identification)

    def opened(folder: RunFolder, byte_log: Any, start_unix_s: float) -> Any:
        clock = VirtualClock(start_unix_s, 0.0)
        return bench_around(lambda c: MadeUpPlant(c, truth, most_gwt), SETTINGS, clock, byte_log)

    session = Session(script.as_script(), SETTINGS, finger, Plan(), NewRun(tmp_path), Reader(script))
    return identification, run_on(session, opened, virtual=True)


@pytest.fixture(scope="module")
def identified(finger: Fingertip, tmp_path_factory: pytest.TempPathFactory) -> tuple[Identification, FinishedRun]:
    return _identify(tmp_path_factory.mktemp("identified"), finger, _truth(3))


def test_an_identification_ends_when_the_forces_are_known(identified: tuple[Identification, FinishedRun]) -> None:
    identification, done = identified
    assert done.problem is None
    assert done.complete
    assert 4 <= len(identification.reports) <= 5
    assert len({report.press.indentor for report in identification.reports[:3]}) == 3
    assert identification.mismatch is None
    assert done.duration_s < 180
    prior = FORESEEN.prior
    for name, most in (("x_mm", 0.15), ("height_mm", 0.02)):
        assert abs(identification.learned.mean[prior.index(name)] - _truth(3)[prior.index(name)]) < most


def test_no_reading_of_an_identification_passes_the_trip_of_its_press(
    identified: tuple[Identification, FinishedRun],
) -> None:
    identification, done = identified
    run = read_run(done.folder.path)
    for report in identification.reports:
        highest = max(s["force_gwt"] for s in run.stream("sample") if s["index"] == report.number - 1)
        assert highest < report.trip_gwt
    assert identification.reports[0].surprise.measured_gwt < 0.3 * identification.options.most_gwt


def test_an_identification_reads_a_press_back_from_the_journal(
    identified: tuple[Identification, FinishedRun],
) -> None:
    identification, done = identified
    run = read_run(done.folder.path)
    given = measured_press(run.events, 0, SETTINGS)
    assert given is not None
    samples = [s for s in run.stream("sample") if s["index"] == 0]
    assert given.trajectory.height_mm[-1] == pytest.approx(min(s["height_mm"] for s in samples))
    assert given.trajectory.height_mm[0] >= given.contact_mm
    assert given.by_depth.height_mm[-1] == pytest.approx(-identification.reports[0].press.doi_mm, abs=0.003)
    age_s = SETTINGS.force.sample_period_s
    assert given.trajectory.read_s[-1] == pytest.approx(
        [s["t_s"] for s in samples if s["phase"] == "hold"][-1] - age_s
    )
    assert (np.diff(given.trajectory.read_s) > 0).all()
    assert given.noise_gwt == pytest.approx(0.01, rel=0.5)
    assert abs(given.zero_gwt) < 0.02
    assert given.force_gwt[-1] == pytest.approx(samples[-1]["force_gwt"] - given.zero_gwt)


def test_an_identification_uses_the_hold_of_a_press_without_readings_on_the_way(
    identified: tuple[Identification, FinishedRun],
) -> None:
    run = read_run(identified[1].folder.path)
    whole = measured_press(run.events, 0, SETTINGS)
    assert whole is not None

    def without(*phases: str) -> MeasuredPress | None:
        samples = [s for s in run.stream("sample") if s["phase"] not in phases]
        return measured_press({**run.events, "sample": samples}, 0, SETTINGS)

    held = without("press")
    assert held is not None
    assert 4 < len(held.force_gwt) < len(whole.force_gwt)
    assert held.force_gwt[-1] == whole.force_gwt[-1]
    assert without("press", "hold") is None


def test_a_late_reading_is_assigned_to_the_height_at_which_it_was_taken(
    identified: tuple[Identification, FinishedRun],
) -> None:
    run = read_run(identified[1].folder.path)
    late = SETTINGS.model_copy(update={"force": SETTINGS.force.model_copy(update={"latency_s": 1.0})})
    ready, old = measured_press(run.events, 0, SETTINGS), measured_press(run.events, 0, late)
    assert ready is not None
    assert old is not None
    by_time = {s["t_s"]: s["height_mm"] for s in run.stream("sample") if s["index"] == 0}
    for given in (ready, old):
        assert (given.trajectory.read_s >= given.trajectory.ended_s[given.trajectory.lowest]).all()
        assert (given.trajectory.lowest == ready.trajectory.lowest).all()
        at = given.trajectory.t_s[given.trajectory.lowest]
        assert given.trajectory.height_mm[given.trajectory.lowest] == pytest.approx([by_time[t] for t in at])
    assert (old.trajectory.read_s < ready.trajectory.read_s).any()


def test_identification_corrects_heights_for_the_compliance_of_the_rig(
    identified: tuple[Identification, FinishedRun],
) -> None:
    _, done = identified
    run = read_run(done.folder.path)
    calibration = SimpleNamespace(value=lambda key, otherwise: 0.5)
    given = SimpleNamespace(calibration=calibration, force=SETTINGS.force)
    stiff, soft = measured_press(run.events, 0, SETTINGS), measured_press(run.events, 0, given)  # type: ignore[arg-type]
    assert stiff is not None
    assert soft is not None
    higher = soft.trajectory.height_mm - stiff.trajectory.height_mm
    last = [s for s in run.stream("sample") if s["index"] == 0 and s["phase"] == "press"][-1]
    assert higher[-1] == pytest.approx(0.5 * last["force_gwt"] * GWT_N)
    assert (higher >= 0).all()


def test_the_finger_file_reads_back_and_names_its_runs(
    identified: tuple[Identification, FinishedRun], tmp_path: Path
) -> None:
    identification, done = identified
    (tmp_path / "finger.toml").write_text(finger_file(identification, SETTINGS, [done.folder.events]).as_toml())
    file = read_finger_file(tmp_path / "finger.toml")
    assert file.identified.runs == (done.folder.path.name,)
    assert file.identified.presses == len(identification.measured)
    assert file.identified.posterior.names == FORESEEN.prior.names
    assert file.identified.posterior.mean == pytest.approx(identification.learned.mean, abs=1e-5)
    assert np.array(file.identified.posterior.covariance) == pytest.approx(
        identification.learned.covariance, rel=1e-4
    )
    assert file.identified.place.height_mm == pytest.approx(
        identification.learned.mean[FORESEEN.prior.index("height_mm")], abs=1e-5
    )
    assert len(file.identified.draw) == 16
    stiffness = [math.log(draw.stiffness) for draw in file.identified.draw]
    column = identification.learned.draws[:, FORESEEN.prior.index("ln_stiffness")]
    assert np.mean(stiffness) == pytest.approx(column.mean(), abs=column.std())
    assert file.finger.tissue.stiffness == pytest.approx(math.exp(identification.learned.most_likely[0]), rel=1e-4)
    assert file.relaxation[0][1] == TAU_FAST_S


@pytest.mark.parametrize(("off", "wider"), [(0.3, 1.0), (1.0, 1.0), (4.0, 2.0)])
def test_the_band_widens_when_readings_fit_worse_than_usual(
    identified: tuple[Identification, FinishedRun], off: float, wider: float
) -> None:
    assert Identification(SETTINGS, FORESEEN, IdentificationOptions(GOALS)).own_error == course.MODEL_ERROR
    identification, learned = copy(identified[0]), identified[0].learned
    usual = course.USUAL_MISFIT * int(learned.readings.sum())
    identification.learned = replace(learned, total=off * usual)
    assert identification.own_error == pytest.approx(wider * course.MODEL_ERROR)
    spread = [np.log(w.high / w.low) / (2 * standard_deviations()) for w in identification.widths]
    alone = identification.chooser.goal_widths(learned, 0.0)
    for one, own in zip(spread, alone, strict=True):
        drawn = np.log(own.high / own.low) / (2 * standard_deviations())
        assert one == pytest.approx(np.hypot(drawn, wider * course.MODEL_ERROR))
    file = finger_file(identification, SETTINGS, [identified[1].folder.events])
    assert file.identified.band.model_error == pytest.approx(identification.own_error, abs=1e-6)


@pytest.mark.parametrize("page", [True, False])
def test_an_identification_is_not_resumed(
    identified: tuple[Identification, FinishedRun],
    program: Program,
    tmp_path: Path,
    page: bool,
) -> None:
    run = shutil.copytree(identified[1].folder.path, tmp_path / "run")
    if page:
        (run / IDENTIFICATION_PAGE).touch()
    with (run / "events.jsonl").open("a") as journal:
        journal.write('{"doc": "ev')  # killed while it wrote
    there = {path.name: path.read_bytes() for path in run.iterdir() if path.name != ".lock"}
    ended = program("resume", run)
    assert ended.code == 2
    said = ended.err.splitlines()[-1]
    assert "repeat `rig identify`" in said
    assert (str(run / IDENTIFICATION_PAGE) in said) == page
    assert {path.name: path.read_bytes() for path in run.iterdir() if path.name != ".lock"} == there


def test_a_refused_press_is_not_counted_as_measured(
    finger: Fingertip, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(self: Rig, **_: float) -> None:
        raise LimitError("nothing is pressed", "nothing_pressed")

    monkeypatch.setattr(Rig, "indent", refused)
    identification, done = _identify(tmp_path, finger, _truth(3))
    assert isinstance(done.problem, LimitError)
    assert done.problem.code == "nothing_pressed"
    assert not identification.measured


def test_a_finger_harder_than_the_prior_ends_the_identification_within_its_trips(
    finger: Fingertip, tmp_path: Path
) -> None:
    identification, done = _identify(tmp_path, finger, _truth(3), most_gwt=1.5)
    tripped = isinstance(done.problem, TripError)
    assert tripped or identification.mismatch is not None
    assert all(report.surprise.measured_gwt <= 1.05 * report.trip_gwt for report in identification.reports)


def test_an_identification_names_the_quantities_it_could_not_learn(finger: Fingertip, tmp_path: Path) -> None:
    identification, done = _identify(
        tmp_path, finger, _truth(3), IdentificationOptions(GOALS, width=0.01, presses=2, shapes=("sphere:4",))
    )
    assert done.problem is None
    assert len(identification.reports) == 2
    assert any("is known only to ±" in words and "± 1 %" in words for words in identification.not_learned)
    assert any(words.startswith("tau_slow_s ") for words in identification.not_learned)


# --- shapes that a finger cannot be pressed with ---


def test_identification_omits_an_impossible_shape_and_limits_goals_to_the_possible_depth() -> None:
    usual = IdentificationOptions(usual_goals(course.SHAPES), shapes=("sphere:4", "bar:3.0"))
    shallow = made_up(deepest_mm=0.5)
    found = possible(usual, shallow, {"bar:3.0": "the rim", "sphere:6": "the rim"}, own_goals=True)
    assert found.shapes == ("sphere:4",)
    assert found.goals == (PressAt("cylinder:9", 0.0, 0.49),)
    everywhere = {goal.indentor: "the rim" for goal in usual.goals}
    assert possible(usual, shallow, everywhere, own_goals=True).goals == (PressAt("sphere:4", 0.0, 0.49),)
    assert possible(usual, FORESEEN, {"sphere:6": "the rim"}, own_goals=True).shapes == usual.shapes


@pytest.mark.parametrize(
    ("refused", "own_goals"), [(("sphere:4", "bar:3.0"), True), (("cylinder:9",), False), (("bar:3.0",), False)]
)
def test_identification_is_refused_if_no_shape_is_left_or_a_requested_force_is_impossible(
    refused: tuple[str, ...], own_goals: bool
) -> None:
    options = IdentificationOptions(GOALS, shapes=("sphere:4", "bar:3.0"))
    with raises(BadInputError, "impossible_shape", problem="the rim"):
        possible(options, FORESEEN, dict.fromkeys(refused, "the rim"), own_goals=own_goals)


# --- random fingers ---


def test_a_random_finger_depends_on_its_seed_alone_and_leaves_limits_and_mesh_unchanged() -> None:
    truth = truth_of(7)
    assert truth == truth_of(7)
    assert truth != truth_of(8)
    assert set(truth) == set(Prior().names)
    bench = with_random_finger(Config(), 7)
    assert bench.finger.tissue.stiffness == pytest.approx(math.exp(truth["ln_stiffness"]))
    assert bench.finger.tissue.e_fat == pytest.approx(math.exp(truth["ln_e_fat"]))
    assert bench.virtual.finger_x_offset_mm == truth["x_mm"]
    assert bench.virtual.finger_z_offset_mm == truth["height_mm"]
    assert bench.virtual.cell_noise_gwt == CELL_NOISE_GWT
    assert bench.virtual.relaxation == (
        (truth["share_fast"], TAU_FAST_S),
        (truth["share_slow"], math.exp(truth["ln_tau_slow_s"])),
    )
    assert bench.limits == Config().limits
    assert bench.finger.mesh == Config().finger.mesh


def test_identification_raises_the_touch_force_above_the_noise() -> None:
    for set_gwt, used_gwt in ((0.03, 0.1), (0.1, 0.1), (0.4, 0.4)):
        config = Config().model_copy(
            update={"habits": Config().habits.model_copy(update={"touch_force_gwt": set_gwt})}
        )
        assert with_reliable_touch(config).habits.touch_force_gwt == used_gwt
