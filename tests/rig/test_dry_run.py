"""Dry-runs on the default fingertip, from script to report."""

import base64
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import pytest

from rig.data import Run, read_run
from rig.data.journal import read_journal
from rig.plan.config import Config
from rig.plan.plan import make_plan
from rig.protocol.script import load_script
from rig.records import Phase
from rig.report.run_report import write_report
from rig.report.run_tables import phases
from rig.session.session import FinishedRun, NewRun, Session, dry_run
from sim.models.fingertip import Fingertip

PRESS = """\
from rig.protocol import Rig

def run(rig: Rig) -> None:
    rig.mount("{shape}")
    rig.home()
    rig.zero()
    for x_mm in {xs}:
        rig.move_to(x_mm=x_mm)
        rig.indent({how})
"""
STEP = {"shape": "step:1", "xs": (-0.51,), "how": "force_gwt=2.33, hold_s=0.5"}
BAR = {"shape": "bar:3.0", "xs": (0.0,), "how": "doi_mm=0.5, hold_s=0.2"}


def _run(folder: Path, finger: Fingertip, what: dict[str, Any], **tables: Any) -> FinishedRun:
    path = folder / "press.py"
    path.write_text(PRESS.format(**what), encoding="utf-8")
    script, config = load_script(str(path)), Config.model_validate(tables)
    plan = make_plan(script, config, finger)
    return dry_run(Session(script, config, finger, plan, NewRun(folder / "runs")))


@pytest.fixture(scope="module")
def step(finger: Fingertip, tmp_path_factory: pytest.TempPathFactory) -> FinishedRun:
    """Step 1 pressed to 2.33 gwt at one position."""
    return _run(tmp_path_factory.mktemp("step"), finger, STEP)


@pytest.fixture(scope="module")
def bar(finger: Fingertip, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """The 3 mm bar pressed to 0.5 mm, everything as configured."""
    return read_run(_run(tmp_path_factory.mktemp("bar"), finger, BAR).folder.path)


def _wire(run: Run) -> list[dict[str, Any]]:
    return [json.loads(line) for line in run.folder.bytes_log.read_text(encoding="ascii").splitlines()]


# --- one position ---


def test_a_dry_run_at_one_position_reaches_depth_place_and_model_force_within_tolerance(
    step: FinishedRun, finger: Fingertip
) -> None:
    assert step.complete
    assert step.indentations == 1
    assert step.problem is None
    run = read_run(step.folder.path)
    (hold,) = run.stream("hold_end")
    assert hold["force_gwt"] == pytest.approx(2.33, abs=0.05)
    assert hold["x_mm"] == -0.51
    assert hold["true_x_mm"] == pytest.approx(-0.51, abs=0.5 / 400)
    # What the balance read is the model's force at the true pose, to half a division.
    model = finger.indent("step:1", hold["true_x_mm"], doi_mm=hold["true_doi_mm"])
    assert hold["force_gwt"] == pytest.approx(model.force_gwt, abs=0.0051)
    assert 15 < step.duration_s < 120


def test_each_journaled_reading_arrived_on_the_wire_just_before(step: FinishedRun) -> None:
    run = read_run(step.folder.path)
    weights = iter([c for c in _wire(run) if c["port"] == "force" and c["dir"] == "rx"])
    for sample in run.stream("sample"):
        last = None
        for chunk in weights:
            last = chunk
            if chunk["t_s"] >= sample["t_s"] - 1e-6:
                break
        assert last is not None
        assert last["t_s"] == pytest.approx(sample["t_s"], abs=1e-5)


def test_the_report_page_loads_nothing_from_elsewhere(step: FinishedRun, finger: Fingertip) -> None:
    text = write_report(read_run(step.folder.path), finger, step.wall_s).read_text(encoding="utf-8")
    page = re.sub(r"<script.*?</script>", "", text, flags=re.DOTALL)
    outside = re.findall(r"""(?:src|href|url)\s*[=(]\s*["']?(?!data:|\#)([^"')\s>]+)""", page)
    assert outside == []
    loaded = re.compile(r"https?:|@import|import\(|import .* from|fetch\(|XMLHttpRequest|WebSocket|sendBeacon")
    comments = re.compile(r"/\*.*?\*/|(?<=\s)//[^\n]*", re.DOTALL)
    for part in re.split(r"</?script[^>]*>", text):
        assert not loaded.search(comments.sub("", part))
    assert not re.search(r"<script[^>]*src", text)
    figures = re.findall(r'src="data:image/svg\+xml;base64,([^"]+)"', text)
    assert len(figures) == text.count("<img") >= 3
    for figure in figures:
        svg = base64.b64decode(figure).decode()
        assert svg.rstrip().endswith("</svg>")
        assert not re.findall(r'(?:href|src)="(?!#|data:)[^"]*"', svg)
    assert "Complete:" in text
    anchors = set(re.findall(r'href="#([^"]+)"', text))
    assert anchors
    assert anchors <= set(re.findall(r'id="([^"]+)"', text))


def test_two_dry_runs_of_a_script_give_the_same_journal_and_bytes(
    step: FinishedRun, finger: Fingertip, tmp_path: Path
) -> None:
    again = _run(tmp_path, finger, STEP)

    def timeless(done: FinishedRun) -> list[dict[str, Any]]:
        return [
            {k: v for k, v in d.items() if k not in ("uid", "unix_s", "crc32")}
            for d in read_journal(done.folder.events)
        ]

    assert timeless(again) == timeless(step)
    assert again.folder.bytes_log.read_bytes() == step.folder.bytes_log.read_bytes()


# --- a bench that is not as believed ---


def test_a_wrong_screw_pitch_shows_in_true_depth_and_force_but_not_in_the_board_position(
    bar: Run, finger: Fingertip, tmp_path: Path
) -> None:
    """The vertical screw has 408 steps/mm where the board believes 400."""
    wrong = read_run(
        _run(tmp_path, finger, BAR, virtual={"z_screw_steps_per_mm": 408.0}, limits={"search_mm": 1.0}).folder.path
    )
    (hold,) = wrong.stream("hold_end")
    height = [s["height_mm"] for s in wrong.stream("sample") if s["phase"] == "hold"][-1]
    commanded_z = -25.0 + height
    # The board is where it was sent, as far as it knows.
    rx = b"".join(
        bytes.fromhex(c["hex"])
        for c in _wire(wrong)
        if c["port"] == "stage" and c["dir"] == "rx" and c["t_s"] <= hold["t_s"]
    )
    reported_z = float(re.findall(rb"MPos:[^,]+,[^,]+,(-?[\d.]+)", rx)[-1])
    assert reported_z == pytest.approx(commanded_z, abs=0.5 / 400 + 0.0005)
    # Its steps put the carriage somewhere else.
    true_height = round(commanded_z * 400) / 408.0 + 25.0
    touch = finger.touch_height_mm("bar:3.0", hold["true_x_mm"]) - finger.apex_height_mm
    assert hold["true_doi_mm"] == pytest.approx(touch - true_height, abs=1e-6)
    # Touch-off takes up the offset; the way pressed from there is short by 2 %.
    found = wrong.stream("touch")[0]
    pressed = found["height_at_threshold_mm"] - height
    at_threshold = found["doi_bias_mm"] + found["true_doi_bias_mm"]
    assert hold["true_doi_mm"] - at_threshold == pytest.approx(pressed * 400 / 408, abs=1 / 400)
    # The force is the model's at the true depth, not at the one the rig believes.
    force = finger.indent("bar:3.0", hold["true_x_mm"], doi_mm=hold["true_doi_mm"]).force_gwt
    believed = finger.indent("bar:3.0", hold["true_x_mm"], doi_mm=hold["doi_mm"]).force_gwt
    assert hold["force_gwt"] == pytest.approx(force, abs=0.0051)
    assert abs(hold["force_gwt"] - believed) > 0.02
    right = bar.stream("hold_end")[0]
    assert hold["doi_mm"] == pytest.approx(right["doi_mm"], abs=0.0025)
    assert hold["true_doi_mm"] < right["true_doi_mm"]
    assert hold["force_gwt"] < right["force_gwt"]


def test_a_dry_run_finds_a_finger_higher_than_configured(bar: Run, finger: Fingertip, tmp_path: Path) -> None:
    offset_mm = 0.3
    run = read_run(_run(tmp_path, finger, BAR, virtual={"finger_z_offset_mm": offset_mm}).folder.path)
    found, was = run.stream("touch")[0], bar.stream("touch")[0]
    assert found["contact_height_mm"] - was["contact_height_mm"] == pytest.approx(offset_mm, abs=0.011)
    assert abs(found["true_doi_bias_mm"]) < 0.011
    hold, right = run.stream("hold_end")[0], bar.stream("hold_end")[0]
    assert hold["doi_mm"] == pytest.approx(0.5, abs=0.0025)
    assert hold["true_doi_mm"] == pytest.approx(right["true_doi_mm"], abs=0.012)
    assert hold["force_gwt"] == pytest.approx(right["force_gwt"], abs=0.25)


# --- many holds, and an operator ---


def test_the_report_counts_the_duration_of_every_phase_of_a_run(bar: Run) -> None:
    """A reading that ended a motion among them: such a run has a report, too."""
    (start,) = bar.stream("sample")[:1]
    known = [phase for phase in get_args(Phase) if phase != "compliance"]
    samples = [{**start, "phase": phase, "t_s": start["t_s"] + n} for n, phase in enumerate(known)]
    every = replace(bar, events={**bar.events, "sample": samples})
    assert sum(phase.seconds for phase in phases(every)) > 0


def test_the_report_states_what_the_motions_of_each_phase_need_at_least(bar: Run) -> None:
    """A lift of 2.5 mm at 5 mm/s and 50 mm/s² needs 0.6 s. One press goes nowhere aside."""
    found = {phase.name: phase for phase in phases(bar)}
    assert found["hold"].least_s is None
    assert found["lift"].least_s == pytest.approx(0.6, abs=0.02)
    for name in ("lateral moves", "approach", "touch-off", "press and seek", "lift"):
        least_s = found[name].least_s
        assert least_s is not None
        assert 0.0 <= least_s < found[name].each_s
