"""Spikes of simulated afferents beside a run: from its journal to files, report and `rig compare`."""

import csv
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rig.compare.recordings.spikes import rates_in_run, read_spike_times
from rig.data import Run, read_run
from rig.data.export import export_nwb
from rig.data.spike_files import SpikeRecord, SpikeTrain, read_spikes, write_csv, write_nix
from rig.errors import BadInputError
from rig.plan.config import Config, load_config
from rig.plan.nerve import SpikeRequest, Visit, run_spikes, visits_of
from rig.report.nerve_figures import nerve_figures
from rig.units import GWT_N
from sim.models.fingertip import Fingertip
from tests.error_codes import raises
from tests.program import Program, press_script
from tests.sim.coarse_mesh import as_toml, coarse_mesh

OLD_RUNS = Path(__file__).parents[1] / "data" / "runs"
AFFERENTS = "SA1@0,SA1@1:0.5,RA@0"


@pytest.fixture
def run(tmp_path: Path) -> Run:
    """Five presses of a bar to 0.4 mm."""
    return read_run(shutil.copytree(OLD_RUNS / "complete", tmp_path / "complete"))


@pytest.fixture
def config(run: Run) -> Config:
    """Its configuration."""
    return load_config(run.folder.config)


def _spikes(run: Run, config: Config, finger: Fingertip, afferents: str = AFFERENTS, seed: int = 0) -> SpikeRecord:
    drawn = SpikeRequest(afferents, seed).drawn(finger)
    return run_spikes(run, visits_of(run, config), finger, drawn, seed=seed)


# --- the journal ---


def test_the_depth_given_to_afferents_is_that_of_the_journal(run: Run, config: Config) -> None:
    """At every sample the indentor is where it was read, at the depth of the fit and the virtual bench's truth."""
    found = visits_of(run, config)
    assert found.left_out == 0
    assert [round(one.x_mm, 2) for one in found.visits] == [3.0, 1.5, 0.0, -1.5, -3.0]
    for index, visit in enumerate(found.visits):
        (hold,) = [one for one in run.stream("hold_end") if one["index"] == index]
        touch = next(one for one in run.stream("touch") if one["index"] == index)
        assert visit.path.depth_mm(hold["t_s"]) == pytest.approx(hold["true_doi_mm"], abs=0.01)
        bias = np.mean([touch["true_doi_bias_mm"], hold["true_doi_mm"] - hold["doi_mm"]])
        for sample in (one for one in run.stream("sample") if one["index"] == index):
            expected = touch["contact_height_mm"] - sample["height_mm"] + bias
            assert visit.path.depth_mm(sample["t_s"]) == pytest.approx(expected, abs=1e-9)
        end = next(one for one in run.stream("indentation_end") if one["index"] == index)
        assert visit.path.depth_mm(end["t_s"]) < 0


def _without(run: Run, *streams: str) -> Run:
    return replace(run, in_order=[(name, event) for name, event in run.in_order if name not in streams])


def test_a_run_without_presses_or_without_contact_heights_has_no_spikes(run: Run, config: Config) -> None:
    with raises(BadInputError, "no_presses", run=str(run.folder.path)):
        visits_of(replace(run, in_order=[]), config)
    with raises(BadInputError, "no_contact_heights", run=str(run.folder.path)):
        visits_of(_without(run, "touch"), config)


def test_the_simulated_indentor_lifts_after_a_run_that_was_killed_in_a_hold(run: Run, config: Config) -> None:
    """The journal ends in contact; the depth does not stay for ever."""
    last = max(n for n, (name, _) in enumerate(run.in_order) if name == "hold_end")
    found = visits_of(replace(run, in_order=list(run.in_order)[: last + 1]), config)
    assert len(found.visits) == 5
    assert found.visits[-1].path.depth_mm(found.visits[-1].path.times_s[-1]) < 0


GIVES = {"compliance_mm_per_n": {"value": 1.0, "sd": 0.01, "date": "2026-01-01", "expires": "2036-01-01"}}
"""What a soft rig gives: 0.0098 mm for each gwt."""


def _sample(t_s: float, height_mm: float, force_gwt: float = 0.0, phase: str = "press", x_mm: float = 1.0) -> Any:
    return "sample", {"t_s": t_s, "x_mm": x_mm, "height_mm": height_mm, "force_gwt": force_gwt, "phase": phase}


BEGUN: list[tuple[str, dict[str, Any]]] = [
    ("mount", {"t_s": 0.0, "indentor": "bar:3.0"}),
    ("move", {"t_s": 1.0, "x_mm": 1.0, "along_mm": 0.25, "height_mm": 2.0}),
    ("indentation_start", {"t_s": 1.5, "index": 0}),
    _sample(6.0, 0.1, phase="approach"),
    ("touch", {"t_s": 7.0, "contact_height_mm": 0.0}),
]
LIFTED = ("retract", {"t_s": 20.0, "height_mm": 2.0})


def _visit(run: Run, *events: Any, begun: Any = BEGUN, **tables: Any) -> Visit:
    """The only visit of such a journal."""
    config = Config.model_validate({"calibration": GIVES, **tables})
    (visit,) = visits_of(replace(run, in_order=[*begun, *events], end_s=21.0), config).visits
    return visit


def test_a_simulated_press_uses_the_true_place_where_known_and_else_that_of_the_move(run: Run) -> None:
    """A press may begin without the name of its indentor; what was mounted is on."""
    held = {"t_s": 9.0, "doi_mm": 0.5}
    truth = {"true_doi_mm": 0.52, "true_x_mm": 1.02}
    found = _visit(run, _sample(8.0, -0.5), ("hold_end", held), LIFTED)
    assert (found.indentor, found.x_mm, found.along_mm) == ("bar:3.0", 1.0, 0.25)
    assert found.path.depth_mm(8.0) == pytest.approx(0.5, abs=1e-9)
    found = _visit(run, _sample(8.0, -0.5), ("hold_end", held | truth), LIFTED)
    assert (found.indentor, found.x_mm, found.along_mm) == ("bar:3.0", 1.02, 0.25)
    assert found.path.depth_mm(8.0) == pytest.approx(0.52, abs=1e-9)
    found = _visit(run, ("indentation_start", {"t_s": 7.5, "indentor": "step"}), _sample(8.0, -0.5), LIFTED)
    assert found.indentor == "step"


def test_the_depth_given_to_afferents_is_corrected_for_the_compliance_of_the_rig(run: Run) -> None:
    visit = _visit(run, _sample(8.0, -0.5, 10.0), LIFTED)
    assert visit.path.depth_mm(8.0) == pytest.approx(0.5 - 10.0 * GWT_N, abs=1e-9)


@pytest.mark.parametrize(("phase", "mm_s"), [("press", 0.8), ("approach", 0.2)])
def test_each_simulated_move_has_the_speed_of_its_phase(run: Run, phase: str, mm_s: float) -> None:
    """0.4 mm: at half its time it is half way, and it rests at its end."""
    habits = {"press_speed_mm_s": 0.8, "approach_speed_mm_s": 0.2}
    visit = _visit(run, _sample(8.0, -0.1), _sample(18.0, -0.5, phase=phase), LIFTED, habits=habits)
    lasts_s = 0.4 / mm_s + mm_s / Config().stage.acceleration_mm_s2
    assert visit.path.depth_mm([8.0 + lasts_s / 2, 8.0 + lasts_s]) == pytest.approx([0.3, 0.5], abs=1e-6)
    assert visit.path.depth_mm(8.0 + 0.95 * lasts_s) < 0.4999


# --- spikes ---


@pytest.mark.usefixtures("cheap_measures")
def test_simulated_spikes_repeat_with_their_seed(run: Run, config: Config, finger: Fingertip) -> None:
    first, again = _spikes(run, config, finger), _spikes(run, config, finger)
    assert [one.spike_s.tolist() for one in first.trains] == [one.spike_s.tolist() for one in again.trains]
    alone = _spikes(run, config, finger, "RA@0")
    assert alone.trains[0].spike_s == pytest.approx(first.trains[2].spike_s, abs=1e-9)
    other = _spikes(run, config, finger, seed=1)
    assert other.trains[0].spike_s.tolist() != first.trains[0].spike_s.tolist()


@pytest.mark.usefixtures("cheap_measures")
def test_afferents_fire_while_they_are_pressed(run: Run, config: Config, finger: Fingertip) -> None:
    """Each spike comes in a visit or shortly after it, later by the delay; the receptor under the bar fires."""
    found = visits_of(run, config)
    trains = _spikes(run, config, finger).trains
    assert len(trains[0].spike_s) > 5
    for train in trains:
        at_receptor = train.spike_s - train.delay_s
        inside = [
            (at_receptor >= one.path.times_s[0]) & (at_receptor <= one.path.times_s[-1] + 0.2) for one in found.visits
        ]
        assert np.any(inside, axis=0).all()
        assert (np.diff(train.spike_s) > 0).all()


@pytest.mark.usefixtures("cheap_measures")
def test_simulated_spikes_do_not_depend_on_the_piece_length(
    run: Run, config: Config, finger: Fingertip, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = _spikes(run, config, finger)
    monkeypatch.setattr("rig.plan.nerve.PIECE_S", 7.3)
    parts = _spikes(run, config, finger)
    assert len(whole.trains[0].spike_s)
    for one, other in zip(whole.trains, parts.trains, strict=True):
        assert np.array_equal(one.spike_s, other.spike_s)


# --- files ---


@pytest.fixture
def record() -> SpikeRecord:
    """Times of which every digit counts."""
    rng = np.random.default_rng(5)
    trains = [
        SpikeTrain(f"SA1-{k}", "SA1", 0.1 * k, -0.3, 0.75, 1 / 3, 1 / 230, np.sort(rng.uniform(30.0, 60.0, 40 * k)))
        for k in range(3)
    ]
    return SpikeRecord(tuple(trains), 7, 0.2)


def _with_pulses(run: Run) -> Run:
    pulses = [{"t_s": t, "rise_s": t, "width_s": 0.01, "uncertainty_s": 0.001} for t in (31.123457, 40.1, 55.300001)]
    return replace(run, events={**run.events, "sync": pulses})


def _same(record: SpikeRecord, times: Callable[[int], Any]) -> None:
    """Every spike is there to the last bit; an afferent may be silent."""
    for k, train in enumerate(record.trains):
        if len(train.spike_s):
            assert np.asarray(times(k)).tolist() == train.spike_s.tolist()


def test_spikes_in_csv_are_read_back_to_the_last_bit(run: Run, record: SpikeRecord) -> None:
    write_csv(run.folder, record)
    again = read_spikes(run.folder)
    assert again is not None
    _same(record, lambda k: again.trains[k].spike_s)
    assert [replace(one, spike_s=record.trains[0].spike_s) for one in again.trains] == [
        replace(one, spike_s=record.trains[0].spike_s) for one in record.trains
    ]
    assert (again.seed, again.path_m) == (7, 0.2)


def test_spikes_in_nwb_are_read_back_to_the_last_bit(run: Run, record: SpikeRecord) -> None:
    pynwb: Any = pytest.importorskip("pynwb", reason="needs pynwb: pip install 'indentation-rig[nwb]'")
    run = _with_pulses(run)
    path = export_nwb(run, record)
    assert path.name == "synthetic_spikes.nwb"
    with pynwb.NWBHDF5IO(path, "r") as io:
        file = io.read()
        _same(record, lambda k: file.units["spike_times"][k])
        assert file.session_description.startswith("Synthetic")
        assert all(one.startswith("synthetic") for one in (file.identifier, path.name))
        assert file.units["afferent"][:].tolist() == ["SA1-0", "SA1-1", "SA1-2"]
        assert "0.2 m" in file.electrode_groups["nerve"].location
        assert "sync_pulses" in file.intervals
    _same(record, lambda k: read_spike_times(path, run, str(k)).spike_s)


@pytest.mark.parametrize("silent", [1, 3])
def test_the_nwb_inspector_accepts_a_file_of_simulated_spikes(run: Run, record: SpikeRecord, silent: int) -> None:
    """One afferent of three is silent, or all are: inspectors fail on a column without any spike."""
    pynwb: Any = pytest.importorskip("pynwb", reason="needs pynwb: pip install 'indentation-rig[nwb]'")
    inspector: Any = pytest.importorskip("nwbinspector", reason="needs nwbinspector: pip install nwbinspector")
    trains = [replace(one, spike_s=np.empty(0)) if k < silent else one for k, one in enumerate(record.trains)]
    path = export_nwb(_with_pulses(run), replace(record, trains=tuple(trains)))
    with pynwb.NWBHDF5IO(path, "r") as io:
        file = io.read()
        assert (file.units is None, file.notes.endswith("no table of units")) == (silent == 3, silent == 3)
    assert pynwb.validate(path=str(path)) in ([], ([], 0))
    found = inspector.inspect_nwbfile(nwbfile_path=str(path))
    # what nobody did, nowhere, is left out; a number may be 0 or 1 by chance
    left = {"check_experimenter_exists", "check_institution", "check_column_binary_capability"}
    assert {one.check_function_name for one in found} <= left


def test_spikes_in_nix_are_read_back_to_the_last_bit(run: Run, record: SpikeRecord) -> None:
    pytest.importorskip("nixio", reason="needs neo and nixio: pip install 'indentation-rig[neo]'")
    run = _with_pulses(run)
    path = write_nix(run, record)
    assert path is not None
    assert path.name == "synthetic_spikes.nix"
    _same(record, lambda k: read_spike_times(path, run, f"SA1-{k}").spike_s)


# --- the command ---


@pytest.mark.usefixtures("cheap_measures", "empty_figures", "finger")
def test_rig_nerve_writes_spike_files_and_report_figures(run: Run, program: Program) -> None:
    ended = program("nerve", str(run.folder.path), "--afferents", AFFERENTS, "--json")
    assert ended.code == 0, ended.err
    answer = ended.json
    assert [one["afferent"] for one in answer["afferents"]] == ["SA1-1", "SA1-2", "RA-1"]
    assert all(Path(name).name.startswith("synthetic_") for name in answer["files"])
    text = (run.folder.path / "synthetic_spikes.csv").read_text(encoding="utf-8")
    rows = list(csv.DictReader(text.splitlines()))
    for one in answer["afferents"]:
        assert sum(row["afferent"] == one["afferent"] for row in rows) == one["spikes"]
    assert answer["afferents"][0]["spikes"] > 5
    page = run.folder.report.read_text(encoding="utf-8")
    found = read_spikes(run.folder)
    assert found is not None
    assert all(f">{figure.title}</h2>" in page for figure in nerve_figures(run, found))
    sums = (run.folder.path / "SHA256SUMS").read_text(encoding="utf-8")
    assert all(f"  {Path(name).name}\n" in sums for name in (*answer["files"], answer["report"]))
    assert not run.folder.changed()


@pytest.mark.usefixtures("cheap_measures", "empty_figures")
@pytest.mark.parametrize("command", ["show", "export --csv", f"nerve --afferents {AFFERENTS}"])
def test_a_json_answer_warns_of_a_run_with_a_missing_file(run: Run, program: Program, command: str) -> None:
    (run.folder.path / "protocol.py").unlink()
    name, *options = command.split()
    ended = program(name, str(run.folder.path), *options, "--json")
    assert ended.code == 0, ended.err
    (warning,) = ended.json["warnings"]
    assert warning["run"] == run.folder.path.name
    assert "protocol.py is missing" in warning["warning_text"]


@pytest.mark.usefixtures("cheap_measures")
def test_rates_from_simulated_spikes_are_the_counts_in_the_holds(run: Run, config: Config, finger: Fingertip) -> None:
    """What `rig compare --recorded bar:3.0=synthetic_spikes.nwb#0` reads: counts in the holds, at each position."""
    record = _spikes(run, config, finger, "SA1@0")
    path = export_nwb(run, record)
    spikes = read_spike_times(path, run, "0")
    found = rates_in_run(run, "bar:3.0", spikes, path.name, (0.0, 0.2))
    counts = sorted(
        int(((spikes.spike_s >= one["t_s"]) & (spikes.spike_s < one["t_s"] + 0.2)).sum())
        for one in run.stream("hold_start")
    )
    assert sorted(round(0.2 * float(rate)) for rate in found.rate) == counts
    assert found.name == "synthetic_spikes.nwb"


SCRIPT = press_script("doi_mm=0.4, hold_s=0.3")


@pytest.fixture
def mine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[str, ...]:
    """A press of a finger of few nodes."""
    monkeypatch.chdir(tmp_path)
    Path("mine.py").write_text(SCRIPT, encoding="utf-8")
    Path("coarse.toml").write_text(as_toml(coarse_mesh(0.3, 0.5)), encoding="utf-8")
    return "dry-run", "mine.py", "--config", "coarse.toml", "--json"


@pytest.mark.usefixtures("empty_figures")
def test_a_dry_run_with_afferents_writes_the_spikes_of_rig_nerve(program: Program, mine: tuple[str, ...]) -> None:
    """And `rig nerve` gives the same spikes afterwards."""
    ended = program(*mine, "--afferents", "SA1@0")
    assert ended.code == 0, ended.err
    folder = Path(ended.json["run"])
    spikes = (folder / "synthetic_spikes.csv").read_bytes()
    assert len(spikes.splitlines()) > 5
    assert "Simulated spikes" in (folder / "report.html").read_text(encoding="utf-8")
    assert "  synthetic_spikes.csv\n" in (folder / "SHA256SUMS").read_text(encoding="utf-8")
    assert program("nerve", str(folder), "--afferents", "SA1@0").code == 0
    assert (folder / "synthetic_spikes.csv").read_bytes() == spikes


FORECASTS = {  # afferents, whether any fires: a bar to 0.4 mm by increments of at most 1 mm/s
    "SA1@0": True,  # it follows strain, at any speed
    "RA@0": False,  # its median threshold lies at some 20 mm/s, the most sensitive of ten at 5 mm/s
}


@pytest.mark.parametrize("afferents", FORECASTS)
def test_check_announces_silent_afferents_and_the_speed_at_which_they_fire(
    program: Program, mine: tuple[str, ...], afferents: str
) -> None:
    _, script, *more, _ = mine
    ended = program("check", script, *more, "--afferents", afferents, "--json")
    assert ended.code == 0, ended.err
    firing = {one["model"]: one for one in ended.json["firing"]}
    assert [not one["silent"] for one in firing.values()].count(True) == FORECASTS[afferents]
    assert ("no afferent is expected to fire" in ended.err) != FORECASTS[afferents]
    for one in firing.values():
        assert one["silent"] == (one["firing_speed_mm_s"] > one["press_speed_mm_s"])
