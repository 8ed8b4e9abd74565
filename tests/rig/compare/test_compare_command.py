"""`rig compare` and `rig export`, as people call them."""

import html
import json
import shutil
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from matplotlib.figure import Figure

from rig.cli import compare
from rig.compare.recordings.synthetic import afferent_for, record, write_synthetic
from rig.compare.stimuli import CONTROLS, StimulusRow, stimuli
from rig.compare.verdict import A_CONSTANT
from rig.data import Run, RunFolder, read_run
from rig.data.folder import SCRIPT
from rig.errors import BadInputError
from rig.report.plot import Plot
from rig_shared.user_files import sha256_of
from sim.config import FingertipConfig
from sim.models.fingertip import Fingertip
from tests.error_codes import raises
from tests.program import Program
from tests.rig.compare.conftest import BAR, dry_run_of
from tests.sim.coarse_mesh import coarse_mesh

KEYS = {"shape", "measure", "receptor_mm", "shape_test", "r", "k", "eps0", "run"}

Command = Callable[..., tuple[int, str, str]]

no_figures = pytest.mark.usefixtures("empty_figures")


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, program: Program, tmp_path: Path) -> Command:
    """Run the program here: exit code, standard output, standard error."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments: object) -> tuple[int, str, str]:
        ended = program(*arguments)
        assert "--json" not in arguments or ended.json
        return ended.code, ended.out, ended.err

    return run


@pytest.fixture(scope="module")
def coarse() -> Fingertip:
    """A finger of few nodes, which is soon built and solved."""
    return Fingertip.load(FingertipConfig(mesh=coarse_mesh(0.5, 0.5)))


@pytest.fixture(scope="module")
def run(coarse: Fingertip, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Bar 3.0 on it, at five places."""
    return dry_run_of(BAR, coarse, tmp_path_factory.mktemp("run"))


@pytest.fixture(scope="module")
def stimulus(run: Run, coarse: Fingertip) -> StimulusRow:
    (found,) = stimuli(run, coarse)
    return found


@pytest.fixture(scope="module")
def csv(stimulus: StimulusRow, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A synthetic recording of the run's bar."""
    afferent = afferent_for([stimulus], "ep1", 5, peak=60.0, silent=0.2)
    found = record(afferent, stimulus, np.linspace(-0.6, 0.8, 9), np.random.default_rng(1))
    return write_synthetic(tmp_path_factory.mktemp("recorded"), found)


@no_figures
def test_json_and_report(command: Command, run: Run, csv: Path) -> None:
    code, out, err = command("compare", run.folder.path, "--recorded", f"bar:3.0={csv}", "--out", "a.html", "--json")
    assert (code, err) == (0, "")
    assert out.count("\n") == 1
    answer: dict[str, Any] = json.loads(out)
    assert {"rows", "candidates", "report"} <= set(answer)
    assert len(answer["rows"]) == 180
    assert all(set(row) >= KEYS for row in answer["rows"])
    truth = next(r for r in answer["rows"] if (r["measure"], r["receptor_mm"]) == ("ep1", 0.0))
    assert truth["r"] > 0.9
    (said,) = answer["answers"]
    assert (said["positions"], said["positions_recorded"], said["noise"]["source"]) == (9, 9, "repeats")
    assert {row["measure"] for row in said["rows"] if row["control"]} == {*CONTROLS, A_CONSTANT}
    assert any(row["eps0"] is not None and row["eps0"] < 0 for row in said["rows"])
    (chance,) = answer["chance"]
    assert (chance["positions"], chance["positions_recorded"], chance["looked_at"]) == (9, 9, 180)
    assert truth["shape"] == "bar:3.0"
    assert truth["run"] == run.folder.path.name
    page = Path("a.html").read_text(encoding="utf-8")
    assert page.index("Verdicts</h2>") < page.index("<figure ")
    assert "http" not in page.replace("http://www.w3.org", "")  # nothing is fetched
    assert set(json.loads(Path("a.html.made.json").read_text(encoding="utf-8"))) == {"made_utc", "seconds"}


@pytest.mark.parametrize("drawn", ["empty", "drawn"])
def test_the_same_input_gives_the_same_bytes(
    drawn: str,
    command: Command,
    coarse: Fingertip,
    csv: Path,
    work: Counter[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The second time everything is in the cache."""
    if drawn == "empty":
        monkeypatch.setattr(Plot, "_laid_out", property(lambda plot: Figure((1, 1))))
    run = dry_run_of(BAR, coarse, tmp_path)
    for name in ("a", "b"):
        work.clear()
        options = ("--recorded", f"bar:3.0={csv}", "--out", f"{name}.html")
        assert command("compare", run.folder.path, *options)[0] == 0
        assert work or name == "b"
    assert not work, "nothing is built or solved"
    assert Path("a.html").read_bytes() == Path("b.html").read_bytes()


@no_figures
def test_where_the_receptor_is(command: Command, run: Run, csv: Path) -> None:
    """RequestedRanges within 0.1 mm of x = 0, on six nodes."""
    asked = ("compare", run.folder.path, "--recorded", f"bar:3.0={csv}", "--receptor-x-mm=-0.1,0.1", "--place")
    asked = (*asked, "--depth-range-mm", "0.7,0.85", "--out", "a.html")
    code, out, _ = command(*asked, "--json")
    assert code == 0
    (found,) = json.loads(out)["places"]
    assert (found["positions"], found["positions_recorded"], len(found["rows"])) == (7, 9, 18)
    assert (found["x_range_mm"], found["depth_range_mm"], found["offset_range_mm"]) == (
        [-0.1, 0.1],
        [0.7, 0.85],
        None,
    )
    assert {row["offset_mm"] for row in found["rows"]} == {0.0}
    row = next(row for row in found["rows"] if row["measure"] == "ep1")
    assert row["at_bounds"]
    assert -0.1 <= row["x_mm"] <= 0.1
    assert 0.7 <= row["depth_mm"] <= 0.85
    page = Path("a.html").read_text(encoding="utf-8")
    assert "Receptor location: bar:3.0 at 0.4 mm" in page
    assert "--place" in page


@no_figures
def test_columns_units_and_what_is_left_out(command: Command, run: Run) -> None:
    """Positions in µm from −0.6 to 1.8 mm; the run went from 0.8 to −0.6."""
    rows = [f"{x};{n},5" for n, x in enumerate((-600, 0, 600, 1200, 1800))]
    Path("mine.csv").write_text("\n".join(["x (um);FR", *rows]), encoding="utf-8")
    asked = ("compare", run.folder.path, "--recorded", "bar:3.0=mine.csv", "--receptor-x-mm", "0")
    asked = (*asked, "--columns", "position=x (um),rate=FR", "--out", "a.html")
    code, out, _ = command(*asked, "--json")
    assert code == 0
    answer = json.loads(out)
    assert answer["left_out"] == [
        {
            "shape": "bar:3.0",
            "condition": "0.4 mm",
            "recording": "mine.csv",
            "positions": 5,
            "left_out": [{"receptor_mm": 0.0, "positions_mm": [1.2, 1.8]}],
            "range_needed_mm": [-0.6, 1.8],
            "covered_receptor_x_mm": [],
            "command": "",
            "covered_by_command": 5,
        }
    ]
    assert {row["positions"] for row in answer["rows"]} == {3}
    page = Path("a.html").read_text(encoding="utf-8")
    assert "--columns" in page
    assert "position=x (um),rate=FR" in page


def test_export_writes_the_tables_again(command: Command, run: Run) -> None:
    hold = run.folder.path / "hold_end.csv"
    before = hold.read_bytes()
    hold.unlink()
    code, out, _ = command("export", run.folder.path, "--csv", "--json")
    assert code == 0
    assert str(hold) in json.loads(out)["files"]
    assert hold.read_bytes() == before
    assert "  hold_end.csv\n" in (run.folder.path / "SHA256SUMS").read_text(encoding="utf-8")
    code, _, err = command("export", run.folder.path)
    assert code == 2
    assert err.startswith("rig: export: ")


def _recorded(run: Run) -> dict[str, bytes]:
    """Contents of all files of a run but its report, what the model answers, and the checksums."""
    made = ("report.html", "SHA256SUMS", ".lock")
    files = [path for path in run.folder.path.iterdir() if path.name not in made]
    return {path.name: path.read_bytes() for path in files if not path.name.startswith("model_")}


@no_figures
@pytest.mark.parametrize("what", ["lost", "stopped"])
def test_export_writes_the_report_again_and_no_data(command: Command, run: Run, tmp_path: Path, what: str) -> None:
    """Also of a run that was killed. The checksums of all other files stay, so that a change still shows."""
    again = read_run(shutil.copytree(run.folder.path, tmp_path / "again"))
    folder, sums = again.folder, again.folder.path / "SHA256SUMS"
    code, out, _ = command("export", folder.path, "--report", "--json")
    made = [Path(name).name for name in json.loads(out)["files"]]
    assert (code, made[0]) == (0, "report.html")
    assert set(made[1:]) == {name for name in folder.files if name.startswith("model_")} != set()
    for name in made:
        (folder.path / name).write_text("old", encoding="utf-8")
        if what == "lost":
            (folder.path / name).unlink()
    if what == "stopped":
        lines = folder.events.read_text(encoding="utf-8").splitlines(keepends=True)
        ended = max(n for n, line in enumerate(lines) if '"stream": "indentation_end", "data"' in line)
        folder.events.write_text("".join(lines[: ended + 1]), encoding="utf-8")
    (folder.path / "sample.csv").write_text("changed by hand", encoding="utf-8")
    before, known = _recorded(again), sums.read_text(encoding="utf-8").splitlines() if sums.exists() else []
    code, out, _ = command("export", folder.path, "--report", "--json")
    assert code == 0
    assert json.loads(out)["files"] == [str(folder.path / name) for name in made]
    assert _recorded(again) == before
    assert "</html>" in folder.report.read_text(encoding="utf-8")
    listed = sums.read_text(encoding="utf-8").splitlines()
    assert {line for line in known if line.split("  ")[1] not in made} <= set(listed)
    digests = dict(reversed(line.split("  ")) for line in listed)
    assert [digests[name] for name in made] == [sha256_of(folder.path / name) for name in made]


def test_the_page_of_an_identification_is_not_replaced(command: Command, run: Run, tmp_path: Path) -> None:
    """It shows what was believed during the identification, which no journal holds."""
    folder = RunFolder(Path(shutil.copytree(run.folder.path, tmp_path / "identified")))
    about = json.loads(folder.provenance.read_text(encoding="utf-8"))
    folder.provenance.write_text(json.dumps(about | {"protocol": SCRIPT}), encoding="utf-8")
    code, out, _ = command("export", folder.path, "--report", "--json")
    assert (code, json.loads(out)["code"], folder.report.exists()) == (2, "identification", False)


@no_figures
def test_spike_times_from_nwb(command: Command, run: Run) -> None:
    """Ten spikes in the window of the hold at x = 0.8 and none elsewhere: the only rate is there."""
    start = next(e["t_s"] for e in run.stream("hold_start") if (e["index"], e["hold"]) == (0, 2))
    with h5py.File("u.nwb", "w") as file:  # the columns of an NWB 2 table of units
        file["units/id"] = [4, 9]
        file["units/spike_times"] = [1.0, *(start + 0.01 * np.arange(1, 11))]
        file["units/spike_times_index"] = [1, 11]
    line = ("compare", run.folder.path, "--window-s", "0,0.4", "--out", "a.html", "--json")
    line = (*line, "--columns", "observed=throughout")
    code, out, _ = command(*line, "--recorded", "bar:3.0=u.nwb#9")
    assert code == 0
    rows = json.loads(out)["rows"]
    # receptors see x = 0.8 as position 0.8 less their own place; five places were pressed
    assert next(row for row in rows if row["receptor_mm"] == 0.0)["positions"] == 5
    assert "u.nwb" in Path("a.html").read_text(encoding="utf-8")
    code, _, err = command(*line, "--recorded", "bar:3.0=u.nwb")
    assert (code, err) == (2, "rig: u.nwb: 2 units; use SHAPE=u.nwb#UNIT with UNIT one of 4, 9\n")


@no_figures
def test_page_json_and_terminal_count_presses_that_were_not_observed_and_state_the_clock(
    command: Command, run: Run
) -> None:
    """The unit is lost before the last of six presses, which repeats x = 0.1."""
    starts = [event["t_s"] for event in run.stream("hold_start") if event["hold"] == 2]
    with h5py.File("u.nwb", "w") as file:
        file["units/id"] = [4]
        file["units/spike_times"] = np.concatenate([t + 0.01 * np.arange(1, 8) for t in starts[:5]])
        file["units/spike_times_index"] = [35]
        file["units/obs_intervals"] = [[0.0, starts[5] - 1]]
        file["units/obs_intervals_index"] = [1]
    line = ("compare", run.folder.path, "--window-s", "0,0.4", "--out", "a.html", "--recorded", "bar:3.0=u.nwb")
    code, printed, _ = command(*line, "--json")
    found = json.loads(printed)
    (recording,) = found["recordings"]
    assert (code, recording["presses"], recording["not_observed_mm"]) == (0, 6, [0.1])
    assert recording["clock"]["source"] == "assumed"
    assert recording["columns_text"] == "Spike times read: units/spike_times in s, unit 4, row 1 of 1."
    assert recording["window_s"] == 0.4
    assert [(one["rate"], one["repeats"]) for one in recording["rates"]] == 5 * [(17.5, [17.5])]  # 7 spikes in 0.4 s
    assert found["clock_shift"]["tried_s"] == [0.02, 0.1, 0.5, 2.0]
    _, printed, _ = command(*line)
    page = Path("a.html").read_text(encoding="utf-8")
    for said in (printed, page):
        assert "1 of 6 presses is not observed" in said
        assert "nothing in the file confirms it" in said
        assert "this clock" in said
        assert "units/spike_times in s" in said
    for said in ("Recorded rates", "17.5", ">7<"):
        assert said in page
    assert "without 1 of 6 presses, not observed" in page


def test_runs_on_different_fingers_are_not_compared_jointly(run: Run, tmp_path: Path) -> None:
    """One fit has one gain for all stimuli, and strains of two fingers differ."""
    runs = []
    for name, stiffness in (("a", 1.0), ("b", 2.0), ("c", 1.0)):
        (tmp_path / name).mkdir()
        (tmp_path / name / "config.toml").write_text(f"[finger.tissue]\nstiffness = {stiffness}\n", encoding="utf-8")
        runs.append(replace(run, folder=RunFolder(tmp_path / name)))
    compare._refuse_other_fingers([runs[0], runs[2]])
    with raises(BadInputError, "other_finger", differing="finger.tissue.stiffness (1.0 and 2.0)"):
        compare._refuse_other_fingers(runs)


@no_figures
def test_a_unit_that_hardly_fired_has_a_report_and_no_verdict(command: Command, run: Run) -> None:
    """One spike, outside all windows: one line on the terminal, "silent" in JSON, one section on the page."""
    with h5py.File("u.nwb", "w") as file:
        file["units/id"] = [4, 9]
        file["units/spike_times"] = [1.0]
        file["units/spike_times_index"] = [1, 1]
    line = ("compare", run.folder.path, "--window-s", "0,0.4", "--out", "a.html", "--columns", "observed=throughout")
    code, out, _ = command(*line, "--recorded", "bar:3.0=u.nwb#4", "--json")
    (verdict,) = json.loads(out)["answers"]
    assert (code, verdict["outcome"], verdict["set"], verdict["rows"]) == (0, "silent", [], [])
    code, out, _ = command(*line, "--recorded", "bar:3.0=u.nwb#4")
    assert code == 0
    assert verdict["answer_text"] in out
    page = Path("a.html").read_text(encoding="utf-8")
    assert verdict["answer_text"] in page
    assert "Recorded over predicted" not in page
    code, out, err = command(*line, "--recorded", "bar:3.0=u.nwb#9", "--json")
    assert (code, json.loads(out)["code"]) == (2, "no_spikes")
    assert "u.nwb#9" in err


@pytest.fixture
def afferents(stimulus: StimulusRow, tmp_path: Path) -> Path:
    """A table of three synthetic afferents, one of them silent."""
    rng, rows = np.random.default_rng(2), ["afferent,shape,depth_mm,file"]
    truth = afferent_for([stimulus], "ep1", 5, 60.0, 0.2)
    for name in ("a0", "a1"):
        path = write_synthetic(tmp_path, record(truth, stimulus, np.linspace(-0.6, 0.8, 9), rng))
        far = path.read_text(encoding="utf-8").splitlines()[-1].partition(",")[2]
        path.write_text(f"{path.read_text(encoding='utf-8')}2.0,{far}\n", encoding="utf-8")  # no run covers it
        rows.append(f"{name},bar:3.0,0.4,{path.rename(tmp_path / f'synthetic_{name}.csv').name}")
    (tmp_path / "silent.csv").write_text("position_mm,rate\n" + "".join(f"{x},0\n" for x in (-0.2, 0.1, 0.4)))
    path = tmp_path / "afferents.csv"
    path.write_text("\n".join([*rows, "a2,bar:3.0,0.4,silent.csv"]) + "\n", encoding="utf-8")
    return path


@no_figures
@pytest.mark.parametrize("recorded", ["bar:3.0={csv}", "{group}"])
def test_an_incomplete_run_is_said_on_the_page_and_in_the_answer(
    recorded: str, command: Command, run: Run, csv: Path, afferents: Path, tmp_path: Path
) -> None:
    """On the page of a comparison and of a group, as on the terminal."""
    folder = Path(shutil.copytree(run.folder.path, tmp_path / "killed"))
    lines = (folder / "events.jsonl").read_text(encoding="utf-8").splitlines(keepends=True)
    last = max(n for n, line in enumerate(lines) if '"stream": "indentation_start"' in line)
    (folder / "events.jsonl").write_text("".join(lines[:last]), encoding="utf-8")
    recorded = recorded.format(csv=csv, group=afferents)
    code, out, err = command("compare", folder, "--recorded", recorded, "--out", "w.html", "--json")
    assert code == 0
    (found,) = json.loads(out)["warnings"]
    assert "the run is incomplete (killed): 5 of 6 indentations done" in found["warning_text"]
    assert found["warning_text"] in err
    assert found["warning_text"] in html.unescape(Path("w.html").read_text(encoding="utf-8"))


@no_figures
@pytest.mark.parametrize("recorded", ["", "bar:3.0={csv}", "{group}"])
def test_a_changed_run_has_its_warnings_on_the_page_and_in_the_answer(
    recorded: str, command: Command, run: Run, csv: Path, afferents: Path, tmp_path: Path
) -> None:
    """On the page of a run, of a comparison and of a group, as on the terminal."""
    folder = Path(shutil.copytree(run.folder.path, tmp_path / "changed"))
    with (folder / "events.jsonl").open("ab") as file:
        file.write(b"rubbish\n")
    with (folder / "config.toml").open("a", encoding="utf-8") as file:
        file.write("\n# by hand\n")
    wanted = read_run(folder).warnings
    assert len(wanted) == 2
    if recorded:
        recorded = recorded.format(csv=csv, group=afferents)
        code, out, err = command("compare", folder, "--recorded", recorded, "--out", "w.html", "--json")
        assert [one["warning_text"] for one in json.loads(out)["warnings"]] == wanted
        page = Path("w.html").read_text(encoding="utf-8")
    else:
        code, _, err = command("export", folder, "--report")
        page = (folder / "report.html").read_text(encoding="utf-8")
    assert code == 0
    for one in wanted:
        assert one in err
        assert one in html.unescape(page)


@no_figures
def test_several_afferents_on_one_page(command: Command, run: Run, afferents: Path) -> None:
    line = ("compare", run.folder.path, "--recorded", afferents, "--out", "g.html")
    code, out, err = command(*line, "--json")
    assert (code, err) == (0, "")
    answer = json.loads(out)
    assert [one["afferent"] for one in answer["afferents"]] == ["a0", "a1"]
    assert answer["afferents_left_out"] == ["a2"]
    assert {one["afferent"] for one in answer["left_out"] if one["left_out"]} == {"a0", "a1", "a2"}
    group = answer["group"]
    assert (group["afferents"], sum(row["wins"] for row in group["rows"])) == (2, 2)
    assert sum(row["probability"] for row in group["rows"]) == pytest.approx(1.0, abs=1e-4)
    page = Path("g.html").read_text(encoding="utf-8")
    assert "synthetic" in page.partition("</title>")[0]
    assert "http" not in page.replace("http://www.w3.org", "")
    code, out, _ = command(*line)
    assert code == 0
    assert "synthetic" in out.splitlines()[0]
    for said in (out, page):
        assert "recorded positions are used" in said
        assert "position_mm as position in mm" in said
    assert "1/s per" in page
    assert Path("g.html").read_text(encoding="utf-8") == page
    for option in ("--place", "--saturating", "--normalize"):
        code, out, _ = command(*line, option, "--json")
        assert (code, json.loads(out)["code"]) == (2, "not_for_groups")


TOO_LATE = {
    "a deflection without a shape across the finger": (
        "bar:3={csv}", "nothing_across", "--deflection", "{deflection}",
    ),
    "a deflection that cannot be read": ("bar:3={csv}", "no_column", "--deflection", "{csv}"),
    "an offset that the run does not cover": (
        "bar:3={csv}", "offset_not_covered", "--place", "--offset-mm=-9,9", "--receptor-x-mm=-0.1,0.1",
    ),
    "a shape that was not pressed": ("step:1={csv}", "never_pressed"),
    "a group with a shape that was not pressed": ("{stray}", "bad_rows"),
    "a group with an offset": ("{group}", "not_for_groups", "--offset-mm=-0.1,0.1"),
    "a group with depths": ("{group}", "not_for_groups", "--depth-range-mm=0.7,0.8"),
    "a group to mirror another shape of": ("{group}", "nothing_to_mirror", "--mirror=step:1"),
}  # fmt: skip
"""What the user did: the recording, the code of the refusal, and options."""


@pytest.mark.parametrize("name", TOO_LATE)
def test_input_is_refused_before_anything_is_built_or_solved(
    name: str, command: Command, run: Run, csv: Path, afferents: Path, work: Counter[str], tmp_path: Path
) -> None:
    """Depths of the receptors that nothing else uses have no cached responses."""
    recorded, code, *options = TOO_LATE[name]
    stray, deflection = tmp_path / "stray.csv", tmp_path / "deflection.csv"
    stray.write_text(afferents.read_text(encoding="utf-8").replace("bar:3.0", "step:1"), encoding="utf-8")
    deflection.write_text("z_mm,deflection_mm\n5,0.1\n6,0.3\n", encoding="utf-8")
    named = {"csv": csv, "group": afferents, "stray": stray, "deflection": deflection}
    given = [text.format(**named) for text in ("--recorded", recorded, *options)]
    depth_mm = 0.7 + 0.001 * (1 + list(TOO_LATE).index(name))
    work.clear()
    ended, out, _ = command("compare", run.folder.path, *given, "--receptor-depth-mm", depth_mm, "--json")
    assert (ended, json.loads(out)["code"]) == (2, code), out
    assert not work
