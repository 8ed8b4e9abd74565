"""Adaptive runs: choices in the journal, kill and resume at every press, what ends one, and what is refused."""

import json
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rig.cli.run import _refuse_mounts
from rig.cli.script_execution import RequestedRun
from rig.data import read_run
from rig.data.choices import verdict_of
from rig.data.documents import as_line
from rig.data.run import read_provenance
from rig.data.run_state import Agenda, Course, Timeline
from rig.design import adaptive_run
from rig.design import design as designs
from rig.design.adaptive_run import ChoosePress, Chooser, ChosenPress, ConfiguredFinger
from rig.design.chooser import ChooserLostError, Decision, InProcessChooser, NextPressChooser
from rig.design.counts_from.growing_file import GrowingFile
from rig.design.counts_from.lsl_stream import LslCounts
from rig.design.counts_from.source import AcceptedCounts, CountSource
from rig.design.design import DesignRequest
from rig.design.designed import as_block
from rig.design.fibers import Unknowns
from rig.design.press_times import PressTimes
from rig.design.response_table import ResponseTable
from rig.design.script_text import script_text
from rig.engine import EngineError, TripError, verbs
from rig.errors import BadInputError, CountError, RunAborted
from rig.plan.config import Config, load_config
from rig.plan.finger_model import FingerModel
from rig.plan.plan import make_plan
from rig.protocol.script import Script, load_script
from rig.session import resume
from rig.session.orders import PressOrders, scope_of
from rig.session.rehearsal_summary import Page, in_both_units
from rig.session.resume import StoppedRun, read_stopped
from rig.session.session import FinishedRun, NewRun, Session, dry_run
from rig.transport import TransportError
from rig.units import GWT_N
from sim.models.fingertip import Fingertip
from tests.program import NEAR_HOME, Program

pytestmark = pytest.mark.usefixtures("empty_figures")

SHAPES = ("bar:1.5", "bar:3.0")
REQUEST = DesignRequest(
    ("ep1", "sed", "e22"), SHAPES, 0.9, "doi_mm", (0.25, 0.5, 1.0), Unknowns(rate_per_s=(60.0, 100.0)),
    hold_s=0.2, rest_s=0.5, change_s=30.0, seed=2,
)  # fmt: skip
TRUTH = "virtual:e22@4"
CHOOSE = f"counts={TRUTH}"
DRY = ("dry-run", "designed.py", "--config", "rig.toml")


@pytest.fixture
def some(table: ResponseTable) -> ResponseTable:
    """Return every sixth press of two shapes."""
    return table.only(range(0, len(table.presses), 6))


@pytest.fixture
def few_times(times: PressTimes, some: ResponseTable) -> PressTimes:
    """Return the times of these presses."""
    return PressTimes(times.first_s, times.press_s[: len(some.presses)], 30.0)


_PREDICTIONS: dict[Any, Any] = {}
"""Of the finger, each solved once; the bumps know nothing of them."""


@pytest.fixture
def here(
    some: ResponseTable, few_times: PressTimes, finger: Fingertip, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Path:
    """Return a folder with a designed script; the table of responses is that of bumps."""
    assert finger is not None
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(designs, "press_times", lambda *_: few_times)
    (tmp_path / "rig.toml").write_text(NEAR_HOME, encoding="utf-8")
    monkeypatch.setattr(designs, "response_table", lambda *_: some)
    adaptive_run._KNOWN.clear()
    monkeypatch.setattr(ResponseTable, "predictions", _PREDICTIONS)
    blocks = [np.array([0, 4, 7]), np.array([11, 14, 18])]
    text = script_text(blocks, some.presses, "About.", "rig design", 0.2, 0.5, as_block(REQUEST, None))
    (tmp_path / "designed.py").write_text(text, encoding="utf-8")
    return tmp_path


def _choices(run: Path) -> list[dict[str, Any]]:
    """Return the choices of a run without what depends on the clock."""
    clocks = ("t_s", "chosen_in_s")
    return [{k: v for k, v in one.items() if k not in clocks} for one in read_run(run).stream("choice")]


def test_a_dry_run_chooses_and_says_what_it_found(here: Path, program: Program) -> None:
    """The verdict is beside the truth in output, JSON and report; each press is what the choice before it says."""
    ended = program(*DRY, CHOOSE, "--json")
    assert ended.code == 0, ended.err
    choice = ended.json["choice"]
    assert (choice["truth"], choice["planned_from"]) == ("e22", None)
    run = read_run(Path(ended.json["run"]))
    choices = run.stream("choice")
    made = [(one["indentor"], one["x_mm"], one["value"]) for one in run.stream("indentation_start")]
    assert [(one["indentor"], one["x_mm"], one["value"]) for one in choices[:-1]] == made
    assert choices[-1]["reason"] == choice["ended"]
    assert choices[-1]["possible"] is None
    assert [one["count"] is None for one in choices] == [True, *[False] * len(made)]
    assert {one["name"]: one["probability"] for one in choice["candidates"]} == json.loads(
        choices[-1]["probabilities"]
    )
    assert run.complete
    (source,) = run.stream("count_source")
    assert (json.loads(source["truth"])["candidate"], source["presses"]) == ("e22", 21)
    assert 'id="verdict"' in run.folder.report.read_text(encoding="utf-8")
    shown = program("show", run.folder.path, "--json").json
    assert shown["choice"] == choice
    again = program(*DRY, CHOOSE, "--json")
    assert _choices(Path(again.json["run"])) == _choices(run.folder.path)


def _requested(script: Script, config: Config, into: NewRun | StoppedRun) -> RequestedRun:
    return RequestedRun(script, config, into, print)


def _cuts(lines: list[dict[str, Any]]) -> list[int]:
    """Return the lengths of the journals that kills leave: in, before and after every press, and at its end."""
    ends = ("choice", "hold_start", "hold_end", "rest")
    return [n + 1 for n, one in enumerate(lines) if one["doc"] == "event" and one["stream"] in ends]


@pytest.mark.quick(rows=lambda killed: killed == "around the first and the last press")
@pytest.mark.parametrize("killed", ["around the first and the last press", "around those between"])
def test_a_run_killed_anywhere_resumes_with_the_same_choices(
    killed: str, here: Path, finger: Fingertip, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Bit for bit: counts, probabilities, presses; no press is lost or made twice."""
    config = load_config(here / "rig.toml")

    def done(script: Script, into: NewRun | StoppedRun) -> FinishedRun:
        before = (into.run, into.folder.path) if isinstance(into, StoppedRun) else (None, None)
        return dry_run(Session(script, config, finger, make_plan(script, config, finger, *before), into))

    whole = done(load_script(str(here / "designed.py"), [CHOOSE]), NewRun(here / "runs")).folder.path
    expected, presses = _choices(whole), len(read_run(whole).done)
    assert presses >= 3
    lines = (whole / "events.jsonl").read_bytes().splitlines(keepends=True)
    cuts = _cuts([json.loads(line) for line in lines])
    assert len(cuts) == 4 * presses + 1
    ends = {*cuts[:4], *cuts[-5:]}
    for number, end in enumerate(sorted(ends if "first" in killed else {*cuts} - ends)):
        folder = here / f"cut{number}"
        shutil.copytree(whole, folder)
        (folder / "events.jsonl").write_bytes(b"".join(lines[:end]) + b'{"doc": "eve')
        stopped = read_stopped(folder)
        resumed = done(stopped.script, stopped)
        assert resumed.complete, (end, resumed.problem)
        assert _choices(folder) == expected, end
        assert (len(resumed.run.done), resumed.run.repeated, resumed.run.missing) == (presses, 0, 0)
        shutil.rmtree(folder)


OTHER_PRESSES = {
    "other presses": (lambda some: some.only(range(2, len(some.presses))), {}),
    "one press": (lambda some: some.only(range(1)), {}),
    "a number beyond the set": (None, {"possible": 10_000}),
    "a negative number": (None, {"possible": -1}),
    "another x": (None, {"x_mm": 0.123}),
    "another indentor": (None, {"indentor": "bar:9.0"}),
}
"""What became of the table of presses, or of the journal."""


def test_a_recorded_number_that_names_another_press_is_refused(
    here: Path, program: Program, monkeypatch: pytest.MonkeyPatch, some: ResponseTable
) -> None:
    """By another version of the finger's model, or by an edited journal: nothing moves."""
    whole = Path(program(*DRY, CHOOSE, "--json").json["run"])
    lines = [json.loads(line) for line in (whole / "events.jsonl").read_bytes().splitlines()]
    numbers = [n for n, one in enumerate(lines) if one["doc"] == "event" and one["stream"] == "choice"]
    recorded = dict(lines[numbers[1]]["data"])
    for name, (other_table, journal) in OTHER_PRESSES.items():
        folder = shutil.copytree(whole, here / name)
        lines[numbers[1]]["data"] = {**recorded, **journal}
        left = b"".join(map(as_line, lines[: numbers[1] + 1]))
        (folder / "events.jsonl").write_bytes(left)
        now = some if other_table is None else other_table(some)
        times = PressTimes(10.0, np.full(len(now.presses), 5.0), 30.0)
        monkeypatch.setattr(designs, "response_table", lambda *_, now=now: now)
        monkeypatch.setattr(designs, "press_times", lambda *_, times=times: times)
        adaptive_run._KNOWN.clear()
        ended = program("resume", folder, "--json")
        code = "choice_changed" if other_table is None else "planned_press_not_possible"
        assert (ended.code, ended.json["code"]) == (2, code), (name, ended.err)
        assert (folder / "events.jsonl").read_bytes() == left, "nothing was made"


def test_a_resume_that_nobody_answers_asks_beforehand_for_all_shapes_that_may_be_chosen(
    here: Path, program: Program, finger: Fingertip, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The planned presses that are left need bar:3.0 alone."""
    path = here / "designed.py"
    text = path.read_text(encoding="utf-8")
    start, blocks, rest = text.partition("BLOCKS = (\n")
    first, second = rest.split('    ("bar:3.0"', 1)
    assert '("bar:1.5"' in first
    path.write_text(f'{start}{blocks}    ("bar:3.0"{second}', encoding="utf-8")
    folder = Path(program(*DRY, CHOOSE, "--json").json["run"])
    lines = (folder / "events.jsonl").read_bytes().splitlines(keepends=True)
    (folder / "events.jsonl").write_bytes(
        b"".join(lines[: 1 + next(n for n, line in enumerate(lines) if b'"zero"' in line)])
    )
    stopped = read_stopped(folder)
    for module in ("rig.cli.run", "rig.cli.confirm"):
        monkeypatch.setattr(f"{module}.can_answer", lambda: False)
    with pytest.raises(BadInputError) as caught:
        _refuse_mounts("resume", _requested(stopped.script, stopped.config, stopped), "bar:3.0")
    assert caught.value.code == "mount_by_hand"


def test_the_page_before_a_run_names_the_strongest_press_and_every_indentor_that_may_be_chosen(
    here: Path, finger: Fingertip
) -> None:
    """The presses of the plan are not those that come."""
    config, script = load_config(here / "rig.toml"), load_script(str(here / "designed.py"), [CHOOSE])
    plan = make_plan(script, config, finger)
    plan.presses["data"] = plan.indentations[:1]
    strongest = max(press.highest_gwt for press in plan.allowed)
    assert strongest > plan.indentations[0].highest_gwt
    assert plan.soft_trip_n == pytest.approx(2 * strongest * GWT_N)
    session = Session(script, config, finger, plan, NewRun(here / "runs"))
    lines = Page(session, EngineError("not rehearsed"), 0.0).lines
    assert in_both_units(strongest * GWT_N) in lines["force"]
    assert str(len(plan.allowed)) in lines["steps"]
    assert all(shape in lines["first"] for shape in SHAPES)
    assert f"{min(one.x_mm for one in plan.allowed):g}" in lines["first"]


@pytest.mark.parametrize(
    ("change", "options", "code"),
    [
        (("", ""), (CHOOSE, "hold_s=0"), "no_hold"),
        (('"e22"', '"e99"'), (CHOOSE,), "unknown_candidate"),
        (('"minutes": 0.9', '"minutes": 0.2'), (CHOOSE,), "too_few_minutes"),
        (('["bar:1.5", "bar:3.0"]', '["bar:1.5"]'), (CHOOSE,), "press_not_designed"),
        (('"seed": 2', '"sow": 2'), (CHOOSE,), "unknown_key"),
        (("BLOCKS = (", "BLOCKS = (3,"), (CHOOSE,), "bad_blocks"),
    ],
)
def test_what_is_refused_before_anything_moves(
    here: Path, program: Program, change: tuple[str, str], options: tuple[str, ...], code: str
) -> None:
    """In one line, without a run folder."""
    path = here / "designed.py"
    old, new = change
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1) if old else text, encoding="utf-8")
    ended = program(*DRY, *options, "--json")
    assert ended.json["code"] == code, ended.err
    assert ended.code == 2
    assert not list(here.glob("runs/*")), "nothing moved"


# --- counts that cannot be right ---


class _Inlet:
    def __init__(self, samples: list[list[Any]]) -> None:
        self.samples = samples

    def pull_chunk(self, timeout: float, max_samples: int) -> tuple[list[list[Any]], list[float]]:
        found, self.samples = self.samples, []
        return found, [0.0] * len(found)

    def close_stream(self) -> None:
        return None


def _in_a_file(rows: list[tuple[Any, Any]], folder: Path) -> CountSource:
    path = folder / "counts.csv"
    path.write_text("index,count\n" + "".join(f"{a},{b}\n" for a, b in rows), encoding="utf-8")
    return GrowingFile(path)


def _in_a_stream(rows: list[tuple[Any, Any]], folder: Path) -> CountSource:
    return LslCounts(_Inlet([[a, b] for a, b in rows]))


WRONG = {
    "nan": ([(0, float("nan"))], "bad_count"),
    "text": ([(0, "many")], "bad_count"),
    "negative": ([(0, -1)], "bad_count"),
    "fractional": ([(0, 2.5)], "bad_count"),
    "huge": ([(0, 1e9)], "bad_count"),
    "twice": ([(0, 3), (0, 4)], "two_counts"),
    "another than before": ([(1, 6)], "two_counts"),
    "not made": ([(0, 3), (2, 4)], "press_not_made"),
    "half a number": ([(0.5, 3)], "no_press_number"),
}


@pytest.mark.parametrize("source", [_in_a_file, _in_a_stream])
@pytest.mark.parametrize("name", WRONG)
def test_a_count_that_cannot_be_right_is_an_error(
    name: str, source: Callable[[list[tuple[Any, Any]], Path], CountSource], tmp_path: Path
) -> None:
    rows, code = WRONG[name]
    counts = AcceptedCounts(source(rows, tmp_path), [None, 5])
    with pytest.raises(CountError) as caught:
        counts.look(2)
    assert caught.value.code == code


@pytest.mark.parametrize(
    ("content", "code"),
    [("0,3\n", "no_header"), ("index,count\n1\n", "bad_line"), ("index,count\n" + "x" * 300, "bad_line"),
     ("index,count\n1,2,3\n", "bad_line"), ("\x00\x01\n", "no_header")],
)  # fmt: skip
def test_a_file_that_is_none_of_counts(content: str, code: str, tmp_path: Path) -> None:
    path = tmp_path / "counts.csv"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(CountError) as caught:
        GrowingFile(path).new()
    assert caught.value.code == code


def test_a_growing_file_gives_each_whole_line_once(tmp_path: Path) -> None:
    path = tmp_path / "counts.csv"
    source = GrowingFile(path)
    assert source.new() == [], "not there yet"
    found = []
    for piece in ("index,co", "unt\n0,", "12", "\r\n1,3\n\n2", ",4\n"):
        with path.open("a", encoding="utf-8", newline="") as file:
            file.write(piece)
        found += source.new()
    assert found == [("0", "12"), ("1", "3"), ("2", "4")]
    path.write_text("index,count\n", encoding="utf-8")
    with pytest.raises(CountError) as caught:
        source.new()
    assert caught.value.code == "shortened"


def test_a_dry_run_whose_counts_can_only_be_recorded_ends_before_a_motion(here: Path, program: Program) -> None:
    ended = program(*DRY, "counts=counts.csv", "--json")
    assert ended.json["code"] == "not_virtual", ended.err
    run = read_run(Path(ended.json["run"]))
    assert run.start["parameters"]["counts"] == str(here / "counts.csv"), "so that it resumes anywhere"
    assert not run.stream("home")


@pytest.mark.parametrize(
    ("before", "after", "code"),
    [
        (
            "            rig.rest(p.rest_s)",
            "            rig.rest(p.rest_s)\n" * 2 + "            rig.indent(doi_mm=0.3)",
            "press_not_chosen",
        ),
        (
            "        mounted, mounts",
            "        rig.mount('bar:3.0')\n        rig.home()\n        rig.zero()\n        rig.move_to(x_mm=0)\n"
            "        rig.indent(doi_mm=0.3)\n        mounted, mounts",
            "press_not_chosen",
        ),
        ("while press := chooser.next():", "while press := swallowing(chooser):", "planned_press_not_possible"),
        (
            "while press := chooser.next():",
            "while press := chooser.next():  # as it is",
            "planned_press_not_possible",
        ),
    ],
    ids=[
        "another press after",
        "another press before",
        "a swallowed refusal",
        "a planned press that cannot be chosen",
    ],
)
def test_a_script_that_its_chooser_does_not_fit_is_refused(
    before: str,
    after: str,
    code: str,
    here: Path,
    program: Program,
    some: ResponseTable,
    few_times: PressTimes,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Counts belong to presses by their index; a press is planned only if it may be chosen."""
    if code == "planned_press_not_possible":
        few = some.only(range(1, len(some.presses)))
        monkeypatch.setattr(designs, "response_table", lambda *_: few)
        monkeypatch.setattr(designs, "press_times", lambda *_: few_times._replace(press_s=few_times.press_s[1:]))
    path = here / "designed.py"
    text = path.read_text(encoding="utf-8")
    assert before in text
    swallowing = """

def swallowing(chooser):
    for _ in range(3):
        try:
            return chooser.next()
        except Exception as error:
            last = error
    raise last
"""
    path.write_text(text.replace(before, after, 1) + swallowing, encoding="utf-8")
    ended = program(*DRY, CHOOSE, "--json")
    assert (ended.code, ended.json["code"]) == (2, code), ended.err
    assert not list(here.glob("runs/*"))


def test_a_run_that_an_earlier_version_began_with_choices_is_not_resumed(
    here: Path, program: Program, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its script would make the planned presses."""
    folder = Path(program(*DRY, "--json").json["run"])
    monkeypatch.setattr(resume, "read_provenance", lambda *of: {**read_provenance(*of), "choose": {"source": TRUTH}})
    ended = program("resume", folder, "--json")
    assert (ended.code, ended.json["code"]) == (2, "earlier_choice"), ended.err


def test_steps_after_a_choice_are_open_until_they_are_chosen() -> None:
    times = Timeline(iter(range(9)).__next__)
    times.event("choice", {})
    times.event("mount", {"indentor": "bar:3.0"})
    times.event("home", {})
    times.event("move", {"x_mm": 0.5})
    agenda = Agenda(Course(9.0, times.instants_s, times.words))
    assert [step.words for step in agenda.steps] == [
        "choose the next press", "mount the chosen indentor", "home", "move to the chosen press"
    ]  # fmt: skip
    agenda.event("choice", {"indentor": "bar:1.5"})
    agenda.event("mount", {"indentor": "bar:1.5"})
    assert (agenda.now, agenda.next) == ("home", "move to the chosen press")
    agenda.event("choice", {"indentor": None})
    assert agenda.now == ""


# --- the wait at clearance ---


def _never() -> bool:
    return False


class _Chooser(NextPressChooser):
    """Chooser that does at each look what a function says."""

    truth: Mapping[str, Any] | None = None

    def __init__(self, look: Callable[[], bool], possible: int | None = 5) -> None:
        self._look, self._possible, self.closed = look, possible, False

    def begin(self, possible: int | None) -> None:
        return None

    def is_ready(self) -> bool:
        return self._look()

    def decision(self) -> Decision:
        return Decision(3, self._possible, "same_shape", 0.1, (0.2, 0.3, 0.5), 0.01)

    def close(self) -> None:
        self.closed = True


@pytest.fixture
def waiting(
    here: Path, finger: Fingertip, spring: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> Callable[..., Any]:
    """Return a function that has a run at clearance wait for its second choice, and returns what came of it."""

    def wait(
        counter: _Chooser | None,
        within_s: float = 0.2,
        problem: TripError | None = None,
        interrupt: Callable[[], bool] = _never,
        lost: Callable[[Any], object] = lambda bench: None,
        counts: str = TRUTH,
    ) -> tuple[ChosenPress, Any]:
        blocks: dict[str, Any] = {}
        exec((here / "designed.py").read_text(encoding="utf-8"), blocks)
        monkeypatch.setattr("rig.design.chooser.ChooserProcess", lambda what, _: counter or InProcessChooser(what))
        chooser = Chooser(
            None,  # type: ignore[arg-type]
            blocks["DESIGN"], blocks["BLOCKS"], hold_s=0.2, rest_s=0.5, counts=counts, within_s=within_s,
        )  # fmt: skip
        config = load_config(here / "rig.toml")
        chooser._choices.append(ChosenPress(chooser._planned[0], 0, "first"))
        step = ChoosePress(index=1, planned=chooser._planned[1], chooser=chooser)
        bench = spring()
        bench.journal.start({"protocol": "p"})
        engine = bench.ready()
        bench.interrupt = interrupt
        engine.stop_inputs = lambda engine, *, at_rest: problem
        lost(bench)
        return chooser.choose(engine, step, ConfiguredFinger(config, FingerModel(finger, {}))), bench

    return wait


def _raising(error: BaseException) -> Callable[[], bool]:
    def look() -> bool:
        raise error

    return look


@pytest.mark.parametrize(
    "look", [_never, _raising(ChooserLostError("gone"))], ids=["no count arrives", "the source has ended"]
)
def test_without_counts_the_plan_goes_on_and_the_run_says_so(
    waiting: Callable[..., Any], look: Callable[[], bool]
) -> None:
    chooser = _Chooser(look)
    found, bench = waiting(chooser)
    assert (found.possible, chooser.closed) == (4, True)
    (alarm,) = bench.of("alarm")
    assert alarm["reason"]
    (choice,) = bench.of("choice")
    assert (choice["reason"], choice["possible"], choice["count"]) == ("plan", 4, None)


@pytest.mark.parametrize(("rows", "code"), [("1,3\n", "press_not_made"), (None, "no_file")])
def test_a_source_that_cannot_be_right_ends_the_run_before_a_motion(
    waiting: Callable[..., Any], tmp_path: Path, rows: str | None, code: str
) -> None:
    """It already has the count of a press that was not made, or it can never be read."""
    counts = tmp_path / "counts.csv" if rows is not None else tmp_path / "no" / "counts.csv"
    if rows is not None:
        counts.write_text(f"index,count\n{rows}", encoding="utf-8")
    with pytest.raises(CountError) as caught:
        waiting(None, counts=str(counts))
    assert caught.value.code == code


@pytest.mark.parametrize("possible", [-1, 42, 10_000])
def test_a_press_that_was_not_checked_is_refused(waiting: Callable[..., Any], possible: int) -> None:
    with pytest.raises(CountError) as caught:
        waiting(_Chooser(lambda: True, possible))
    assert caught.value.code == "press_not_checked"


def test_a_wrong_count_ends_the_run_before_a_motion(waiting: Callable[..., Any]) -> None:
    with pytest.raises(CountError) as caught:
        waiting(_Chooser(_raising(CountError("two", "two_counts"))))
    assert caught.value.code == "two_counts"


def test_ctrl_c_at_the_wait_ends_the_run_at_a_safe_point(waiting: Callable[..., Any]) -> None:
    with pytest.raises(RunAborted) as caught:
        waiting(_Chooser(_never), within_s=60.0, interrupt=lambda: True)
    assert caught.value.code == "stopped_at_a_safe_point"


def test_stop_at_once_is_raised_from_the_wait(waiting: Callable[..., Any]) -> None:
    """As `rig stop`, the panel and a second Ctrl-C interrupt the main thread."""
    with pytest.raises(KeyboardInterrupt):
        waiting(_Chooser(_raising(KeyboardInterrupt())), within_s=60.0)


def test_a_stop_input_trips_during_the_wait(waiting: Callable[..., Any]) -> None:
    with pytest.raises(TripError) as caught:
        waiting(_Chooser(_never), within_s=60.0, problem=TripError("relay", "hardware_trip"))
    assert caught.value.code == "hardware_trip"


@pytest.mark.parametrize(
    ("lost", "error"),
    [
        (lambda bench: bench.stage.close(), TransportError),
        (lambda bench: setattr(bench.balance, "mute", True), TripError),
    ],
    ids=["stage", "force sensor"],
)
def test_a_device_that_is_lost_ends_the_wait(
    waiting: Callable[..., Any],
    lost: Callable[[Any], object],
    error: type[Exception],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(verbs, "REST_LOOK_S", 0.02)
    with pytest.raises(error):
        waiting(_Chooser(_never), within_s=600.0, lost=lost)


@pytest.mark.parametrize("lost", [lambda bench: bench.stage.close(), lambda bench: bench.force.close()])
def test_a_device_that_is_lost_ends_the_wait_for_an_order(
    spring: Callable[..., Any], lost: Callable[[Any], object], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(verbs, "REST_LOOK_S", 0.02)
    bench = spring()
    engine = bench.ready()
    lost(bench)
    with pytest.raises((TransportError, TripError)):
        PressOrders(scope_of({"indentor": "bar:3.0", "force_gwt": 1.0})).next(engine)


def test_a_run_by_the_plan_ends_complete(here: Path, program: Program, monkeypatch: pytest.MonkeyPatch) -> None:
    """Counts stop after the second press: all presses of the plan are made, and resumed, without a source."""

    class _Stops(InProcessChooser):
        def is_ready(self) -> bool:
            if len(self._state.made) == 2:
                raise ChooserLostError("gone")
            return super().is_ready()

    monkeypatch.setattr("rig.design.chooser.InProcessChooser", _Stops)
    ended = program(*DRY, CHOOSE, "--json")
    assert ended.code == 0, ended.err
    run = read_run(Path(ended.json["run"]))
    assert ended.json["choice"]["planned_from"] == 3
    assert [one["reason"] for one in run.stream("choice")][3:] == ["plan"] * 3 + ["plan_done"]
    assert len(run.done) == 6
    verdict = verdict_of(run)
    assert verdict is not None
    assert verdict.ended == "plan_done"
    lines = run.folder.events.read_bytes().splitlines(keepends=True)
    cut = next(n for n, line in enumerate(lines) if b'"reason": "plan"' in line)
    run.folder.events.write_bytes(b"".join(lines[: cut + 1]))
    resumed = program("resume", run.folder.path, "--json")
    assert resumed.code == 0, resumed.err
    assert (resumed.json["indentations"], resumed.json["choice"]["planned_from"]) == (6, 3)
