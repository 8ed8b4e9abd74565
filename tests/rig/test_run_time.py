"""`t_s` is seconds since the run's start wherever it is written or read, whatever the computer's own clock shows.

Real runs on virtual devices: the computer was booted 743.2 s before the run, and for the resumed part 12 s before.
What a run shows is compared with the wall clock in its journal.
"""

import csv
import io
import json
import zipfile
from collections.abc import Callable, Mapping
from contextlib import closing
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import h5py
import pytest
from matplotlib.figure import Figure

from rig.bench.real import Request
from rig.bench.virtual import load_on_sensor, true_carriage, truth, virtual_force, virtual_stage, with_framing
from rig.clock import WallClock
from rig.control.owned_stage import OwnedStage
from rig.data import RunFolder, export_nwb, export_run, read_run
from rig.data.bug_report import bug_report
from rig.data.index import listed
from rig.data.journal import read_journal
from rig.data.run import Following
from rig.data.tables import HOLD_COLUMNS, RUN_COLUMNS, booked_s
from rig.panel.run_view import COLUMNS, RunView
from rig.plan.config import Config
from rig.plan.plan import make_plan
from rig.protocol.script import load_script
from rig.report.run_figures import force_time
from rig.session.resume import read_stopped
from rig.session.session import FinishedRun, NewRun, NoAttendant, Session, real_run, record_after, record_before
from rig.transport.wire import LoopbackTransport
from sim.devices.clock import VirtualClock
from sim.devices.line import Load, SerialLine
from sim.models.fingertip import Fingertip
from sim.plant import Plant

SCRIPT = """\
def run(rig):
    rig.mount("bar:3.0")
    rig.home()
    rig.zero()
    for x_mm in (0.0, 0.5):
        rig.move_to(x_mm=x_mm)
        rig.indent(doi_mm=0.2, hold_s=0.1)
"""
Run = Callable[..., FinishedRun]
BOOTED_S, BOOTED_AGAIN_S = 743.2, 12.0
START_UNIX_S, RESUMED_UNIX_S = 1.7e9, 1.7e9 + 90_000.0
PLANNED_S = 5.0
"""What passes between the opening of the stage and the run: check, rehearsal, confirmation."""
CONFIG = Config.model_validate(
    {"stage": {"port": "STAGE"}, "force": {"port": "FORCE"}, "sync": {"output": "coolant"}},
)


class Computer:
    """Computer of a real run: its clock is virtual, and its ports lead to virtual devices."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, finger: Fingertip) -> None:
        self._patch, self._finger = monkeypatch, finger

    def boot(self, booted_s: float, unix_s: float) -> None:
        """Begin to run, booted_s ago, at this time of the calendar."""
        clock = VirtualClock(unix_s, booted_s)
        config = with_framing(CONFIG, "rtu")
        lines = {"STAGE": SerialLine(clock, config.stage.baud), "FORCE": SerialLine(clock, config.force.baud)}
        board = virtual_stage(clock, lines["STAGE"], config)
        self.plant = Plant(self._finger, true_carriage(board, config), truth(config))
        virtual_force(clock, lines["FORCE"], config, load_on_sensor(Load(self.plant.force_n), config))
        self._patch.setattr(
            "rig.clock.time", SimpleNamespace(monotonic=clock.monotonic_s, time=clock.unix_s, sleep=clock.wait_s)
        )
        self._patch.setattr(
            "rig.devices.make_drivers.open_port",
            lambda port, *_, **__: LoopbackTransport(lines[port], WallClock(), port),
        )
        self.clock = clock

    def carry_out(self, session: Session, stage: OwnedStage) -> FinishedRun:
        def mounted(request: Request) -> str:
            self.plant.mount(request.indentor or "")
            return ""

        self.clock.wait_s(PLANNED_S)
        return real_run(session, mounted, stage)


class Impatient(NoAttendant):
    """Observer that ends the run after its first indentation."""

    def __init__(self) -> None:
        self._done = False

    def watch(self, stream: str, data: Mapping[str, Any]) -> None:
        self._done = self._done or stream == "indentation_end"

    def interrupted(self) -> bool:
        return self._done


@pytest.fixture
def computer(monkeypatch: pytest.MonkeyPatch, finger: Fingertip) -> Computer:
    monkeypatch.setattr("rig.data.journal.os.fsync", lambda fd: None)
    return Computer(monkeypatch, finger)


@pytest.fixture
def run(computer: Computer, finger: Fingertip, tmp_path: Path) -> Run:
    """Carry out the script on a computer that was booted 743.2 s ago."""

    def carried_out(*, stopped: bool = False) -> FinishedRun:
        path = tmp_path / "two.py"
        path.write_text(SCRIPT, encoding="utf-8")
        script = load_script(str(path))
        computer.boot(BOOTED_S, START_UNIX_S - PLANNED_S)
        with closing(OwnedStage(CONFIG, WallClock()).open()) as stage:
            plan = make_plan(script, CONFIG, finger)
            attendant = Impatient() if stopped else NoAttendant()
            return computer.carry_out(
                Session(script, CONFIG, finger, plan, NewRun(tmp_path / "runs"), attendant), stage
            )

    return carried_out


@pytest.fixture
def resume(computer: Computer, finger: Fingertip) -> Run:
    """Resume a run after a reboot."""

    def resumed(folder: Path, unix_s: float = RESUMED_UNIX_S) -> FinishedRun:
        computer.boot(BOOTED_AGAIN_S, unix_s - PLANNED_S)
        into = read_stopped(folder)
        with closing(OwnedStage(into.config, WallClock(into.begins_at_s)).open()) as stage:
            plan = make_plan(into.script, into.config, finger, into.run, folder)
            return computer.carry_out(Session(into.script, into.config, finger, plan, into), stage)

    return resumed


def _rewritten(path: Path, change: Callable[[dict[str, Any]], dict[str, Any]]) -> None:
    lines = [json.loads(line) for line in path.read_text(encoding="ascii").splitlines()]
    path.write_text("".join(json.dumps(change(line)) + "\n" for line in lines), encoding="ascii")


def _as_before(folder: Path) -> None:
    """Rewrite a run with the times of earlier versions: since boot."""

    def late(line: dict[str, Any]) -> dict[str, Any]:
        data = dict(line.get("data", {}))
        data |= {"rise_s": data["rise_s"] + BOOTED_S} if "rise_s" in data else {}
        line = {key: value for key, value in line.items() if key != "crc32"}
        return {**line, "t_s": round(line["t_s"] + BOOTED_S, 6)} | ({"data": data} if data else {})

    for name in ("events.jsonl", "bytes.jsonl"):
        _rewritten(folder / name, late)


def _kind(name: str, run: Run, resume: Run, tmp_path: Path) -> Path:
    if name == "fresh":
        return run().folder.path
    folder = run(stopped=True).folder.path
    if name == "old, resumed by this version":
        _as_before(folder)
    resume(folder)
    return folder


KINDS = ("fresh", "resumed", "old, resumed by this version")


@pytest.fixture(params=KINDS)
def folder(
    request: pytest.FixtureRequest,
    run: Run,
    resume: Run,
    tmp_path: Path,
) -> Path:
    """Folder of a finished run."""
    found = _kind(request.param, run, resume, tmp_path)
    for path in [*found.glob("*.csv"), found / "data.h5"]:
        path.unlink(missing_ok=True)
    return found


def _is_hold_end(document: dict[str, Any]) -> bool:
    return document["doc"] == "event" and document["stream"] == "hold_end"


def _true_s(folder: Path) -> list[float]:
    """Return when holds ended, by the wall clock of the journal."""
    documents = list(read_journal(folder / "events.jsonl"))
    start_s = documents[0]["unix_s"]
    return [one["unix_s"] - start_s for one in documents if _is_hold_end(one)]


# --- every place that shows a time: the ends of the holds, as it has them ---


def _csv(folder: Path) -> list[float]:
    export_run(read_run(folder))
    with (folder / "hold_end.csv").open(encoding="utf-8", newline="") as file:
        return [float(row["t_s"]) for row in csv.DictReader(file)]


def _hdf5(folder: Path) -> list[float]:
    export_run(read_run(folder))
    with h5py.File(folder / "data.h5") as file:
        return list(file["hold_end/t_s"][:])


def _nwb(folder: Path) -> list[float]:
    pynwb: Any = pytest.importorskip("pynwb")
    with pynwb.NWBHDF5IO(export_nwb(read_run(folder)), "r") as io:
        file = io.read()
        start = next(read_journal(folder / "events.jsonl"))
        assert file.session_start_time == datetime.fromtimestamp(start["unix_s"], UTC)
        assert file.timestamps_reference_time == file.session_start_time
        assert 0 < file.acquisition["force"].timestamps[0] < 120
        assert min(file.trials.to_dataframe()["start_time"]) > 0
        return list(file.intervals["holds"].to_dataframe()["stop_time"])


def _of_run(folder: Path) -> list[float]:
    run = read_run(folder)
    assert run.start["t_s"] == 0.0
    assert run.end_s == pytest.approx(_true_s(folder)[-1], abs=60.0)
    assert all(abs(pulse["t_s"] - pulse["rise_s"]) < 0.2 for pulse in run.stream("sync"))
    return [event["t_s"] for event in run.stream("hold_end")]


def _followed(folder: Path) -> list[float]:
    documents = Following(RunFolder(folder)).new()
    assert all(a["t_s"] <= b["t_s"] for a, b in pairwise(documents))
    return [one["t_s"] for one in documents if _is_hold_end(one)]


def _index(folder: Path) -> list[float]:
    (found,) = (entry for entry in listed(folder.parent) if entry.summary.name == folder.name)
    return [row[len(RUN_COLUMNS) + HOLD_COLUMNS.index("t_s")] for row in found.rows]


def _panel(folder: Path) -> list[float]:
    """The last reading of a hold is read just before its end."""
    seen = RunView(folder)
    rows = seen.look(0.0)
    assert seen.problem == ""
    assert seen.newest_state(0.0)["t_s"] == rows[-1][COLUMNS.index("t_s")] < _true_s(folder)[-1] + 60
    held = [row[COLUMNS.index("t_s")] for row in rows if row[COLUMNS.index("phase")] == "hold"]
    assert held[-1] == pytest.approx(_true_s(folder)[-1], abs=0.3)
    return _true_s(folder)


def _report(folder: Path) -> list[float]:
    run = read_run(folder)
    figure = Figure()
    force_time(run).draw(figure)
    above, below = figure.axes
    per = 60.0 if "min" in below.get_xlabel() else 1.0
    assert above.get_xlim() == pytest.approx((0.0, run.end_s / per))
    readings = [line for line in above.lines if line.get_linestyle() == "-"]
    drawn = [x for line in readings for x in line.get_xdata() if x == x]
    assert 0 < min(drawn) < max(drawn) < (_true_s(folder)[-1] + 60) / per
    assert sum(booked_s(run).values()) == pytest.approx(run.duration_s, abs=3.0), "not the time between the parts"
    return _true_s(folder)


def _bug_report(folder: Path) -> list[float]:
    to = folder.parent / "bundle.zip"
    bug_report(folder, to, {}, {})
    with zipfile.ZipFile(to) as archive:
        names = archive.namelist()
        documents, chunks = (
            [json.loads(line) for line in io.TextIOWrapper(archive.open(name), "utf-8")] if name in names else []
            for name in ("events.jsonl", "bytes.jsonl")
        )
    _in_a_part(folder, [chunk["t_s"] for chunk in chunks])
    return [one["t_s"] for one in documents if _is_hold_end(one)]


def _in_a_part(folder: Path, times: list[float]) -> None:
    """Assert that bytes are of the parts of a run, at most a second before the first document of each."""
    parts = read_run(folder).parts
    assert all(any(begin - 1.0 <= t_s <= end + 1.0 for begin, end in parts) for t_s in times)
    if times:
        assert all(any(begin - 1.0 <= t_s <= end + 1.0 for t_s in times) for begin, end in parts)


SHOWN = {
    "tables": _of_run,
    "growing journal": _followed,
    "csv": _csv,
    "hdf5": _hdf5,
    "nwb": _nwb,
    "table of runs": _index,
    "panel": _panel,
    "report": _report,
    "bug report": _bug_report,
}


def test_every_output_counts_time_from_the_start_of_the_run(folder: Path, request: pytest.FixtureRequest) -> None:
    if request.node.callspec.params["folder"] in ("fresh", "resumed"):
        _is_written_in_the_time_of_the_run(folder)
    true_s = _true_s(folder)
    assert true_s
    wrong = {}
    for name, shown in SHOWN.items():
        try:
            found = shown(folder)
            if found != pytest.approx(true_s, abs=1e-3):
                wrong[name] = (found, true_s)
        except AssertionError as error:
            wrong[name] = str(error)  # type: ignore[assignment]
    assert wrong == {}


def _is_written_in_the_time_of_the_run(folder: Path) -> None:
    documents = list(read_journal(folder / "events.jsonl"))
    assert (documents[0]["t_s"], documents[0]["unix_s"]) == (0.0, pytest.approx(START_UNIX_S, abs=0.5))
    for one in documents:
        assert one["t_s"] == pytest.approx(one["unix_s"] - documents[0]["unix_s"], abs=1e-3)
    chunks = [json.loads(line)["t_s"] for line in (folder / "bytes.jsonl").read_text("ascii").splitlines()]
    assert chunks == sorted(chunks)
    assert chunks[0] >= 0.0
    _in_a_part(folder, chunks)


def test_a_wall_clock_that_was_set_back_leaves_run_times_ascending(run: Run, resume: Run) -> None:
    folder = run(stopped=True).folder.path
    end_s = read_run(folder).end_s
    assert resume(folder, START_UNIX_S - 3600.0).complete
    documents = list(read_journal(folder / "events.jsonl"))
    assert all(a["t_s"] <= b["t_s"] for a, b in pairwise(documents))
    assert next(one["t_s"] for one in documents if one["doc"] == "resume") == pytest.approx(end_s, abs=0.5)


def test_a_stop_during_planning_has_times_from_the_opening_of_the_ports(computer: Computer, tmp_path: Path) -> None:
    """The run began when its ports were opened: its bytes, and the stop, come later."""
    path = tmp_path / "two.py"
    path.write_text(SCRIPT, encoding="utf-8")
    computer.boot(BOOTED_S, START_UNIX_S)
    with closing(OwnedStage(CONFIG, WallClock()).open()) as stage:
        computer.clock.wait_s(PLANNED_S)
        stage.stop()
        into = NewRun(tmp_path / "runs")
        folder = record_before(load_script(str(path)), CONFIG, into, virtual=False, clock=stage.clock)
        record_after(folder, "planning", stage.kept)
    start, stop = read_journal(folder.events)
    assert (start["t_s"], start["unix_s"]) == (0.0, pytest.approx(START_UNIX_S))
    (chunk, *_) = (json.loads(line)["t_s"] for line in folder.bytes_log.read_text("ascii").splitlines())
    assert PLANNED_S <= chunk <= stop["t_s"] < PLANNED_S + 30.0


def test_bytes_sent_before_a_run_have_times_before_its_start(computer: Computer) -> None:
    computer.boot(BOOTED_S, START_UNIX_S)
    with closing(OwnedStage(CONFIG, WallClock()).open()) as stage:
        computer.clock.wait_s(1.0)
        stage.stop()
        computer.clock.wait_s(PLANNED_S)
        now_s = stage.clock.run_s()
        before = [json.loads(line) for line in stage.kept.splitlines()]
        stage.begin_run(100.0)
    after = [json.loads(line) for line in stage.kept.splitlines()]
    assert [{**one, "t_s": 0.0} for one in after] == [{**one, "t_s": 0.0} for one in before] != []
    assert [one["t_s"] for one in after] == pytest.approx([one["t_s"] - now_s + 100.0 for one in before], abs=1e-5)
