"""`rig watch` and a run's own screen: force, trace, steps and time left; a run is only read, whatever its state."""

import io
import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console
from rich.live import Live

import rig.cli.output as output
import rig.cli.watch as watch_command
from rig.bench.real import Request
from rig.cli.output import a_screen, screen_aside
from rig.cli.run import ask_at_the_bench
from rig.cli.script_execution import AtTheTerminal
from rig.cli.signals import PauseRequest
from rig.cli.watch import RunScreen
from rig.clock import WallClock
from rig.data.folder import RunFolder, UnwritableError
from rig.data.run import Following, RunError, followed, read_run
from rig.data.run_state import Agenda, Course, Timeline, written_ns
from tests.journals import append
from tests.program import Program

OLD = Path(__file__).parents[1] / "data" / "runs"
PRESS = {"indentor": "bar:3.0", "x_mm": 0.5, "target": "force_gwt", "value": 2.33, "increments": 1}
EVENTS: list[tuple[str, dict[str, Any]]] = [
    ("mount", {"indentor": "bar:3.0"}),
    ("home", {"controller": "a"}),
    ("move", {"x_mm": 0.5, "along_mm": 0.0}),
    ("precondition_indentation_start", {"index": 0, **PRESS}),
    ("precondition_touch", {"index": 0}),
    ("precondition_indentation_end", {"index": 0}),
    ("rest", {"rest_s": 2.5}),
    ("indentation_start", {"index": 0, **PRESS}),
    ("touch", {"index": 0}),
    ("hold_start", {"index": 0, "hold": 1}),
    ("hold_end", {"index": 0, "hold": 1}),
    ("indentation_end", {"index": 0}),
    ("find_touch", {"index": 0}),
    ("find", {"index": 0, "x_mm": -1.0}),
]
MOUNT, HOME, MOVE, REST, FIND = "mount bar:3.0", "home", "move to x = +0.50 mm", "rest 2.5 s", "touch at x = -1.00 mm"
FIRST, SECOND = "precondition bar:3.0 at +0.50 mm to 2.33 gwt", "press bar:3.0 at +0.50 mm to 2.33 gwt"
NOW_AND_NEXT = [
    *((MOUNT, HOME), (HOME, MOVE), (MOVE, FIRST), (FIRST, REST), (FIRST, REST), (FIRST, REST), (REST, SECOND)),
    *(
        (SECOND, FIND),
        (SECOND, FIND),
        (SECOND, FIND),
        (SECOND, FIND),
        (SECOND, FIND),
        (FIND, ""),
        (FIND, ""),
        ("", ""),
    ),
]
"""Before the first of them, and after each."""


@pytest.fixture
def course() -> Course:
    """Rehearsed with ten seconds between the events, and five after the last."""
    seconds = [0.0]
    timeline = Timeline(lambda: seconds[0])
    for stream, data in EVENTS:
        seconds[0] += 10.0
        timeline.event(stream, data)
    return Course(seconds[0] + 5.0, timeline.instants_s, timeline.words)


# --- what a run is at ---


def test_the_predicted_timeline_is_stored_beside_the_journal(course: Course, tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    assert (Course.load(folder), written_ns(folder)) == (None, 0)
    course.save(folder)
    assert Course.load(folder) == course
    assert written_ns(folder) == (tmp_path / "timeline.json").stat().st_mtime_ns
    for broken in ("", "{", "[]", '{"duration_s": 1}', '{"duration_s": 1, "passes": [["a"]]}', '{"passes": []}'):
        (tmp_path / "timeline.json").write_text(broken, encoding="utf-8")
        assert Course.load(folder) is None, broken


def test_the_agenda_names_the_current_and_the_next_step(course: Course) -> None:
    agenda = Agenda(course)
    found = [(agenda.now, agenda.next)]
    for stream, data in EVENTS:
        agenda.event("sample", {"index": 0})
        agenda.event(stream, data)
        found.append((agenda.now, agenda.next))
    # until the find's milestone is passed, the press before it is over and touching is what is done
    assert found == NOW_AND_NEXT


def test_the_agenda_returns_to_a_press_that_starts_again(course: Course) -> None:
    agenda = Agenda(course)
    for stream, data in EVENTS[:11]:
        agenda.event(stream, data)
    agenda.event("indentation_start", {"index": 0, **PRESS})
    assert (agenda.now, agenda.next) == (SECOND, FIND)
    agenda.event("rest", {"rest_s": 1.0})  # one more than was rehearsed
    assert agenda.now == SECOND


def test_rig_watch_counts_time_left_on_the_clock_of_the_run(course: Course, tmp_path: Path) -> None:
    course.save(RunFolder(tmp_path))
    seen = RunScreen(RunFolder(tmp_path))
    seen.take([{"doc": "start", "t_s": 1000.0}])
    assert seen.left_s == 145.0
    for t_s, (stream, data), left_s in (
        (1010.0, EVENTS[0], 135.0),
        (1025.0, EVENTS[1], 125.0),
        (1029.0, ("sample", {"force_gwt": 0.0}), 121.0),
        (1300.0, EVENTS[-1], 5.0),
    ):
        seen.take([{"doc": "event", "t_s": t_s, "stream": stream, "data": data}])
        assert seen.left_s == left_s


# --- a journal that grows ---


def _document(kind: str, **body: Any) -> bytes:
    return json.dumps({"doc": kind, "t_s": 0.0, **body}).encode() + b"\n"


def test_a_journal_is_followed_line_by_line(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    following = Following(folder)
    assert following.new() == []
    folder.events.write_bytes(_document("start") + b'{"doc": "ev')
    assert [one["doc"] for one in following.new()] == ["start"]
    assert following.new() == []
    with folder.events.open("ab") as file:
        file.write(b'ent", "t_s": 1, "stream": "note", "data": {}}\n' + _document("resume"))
    assert [one["doc"] for one in following.new()] == ["event", "resume"]
    with folder.events.open("ab") as file:
        file.write(b"noise\n")
        file.write(_document("stop", status="done"))
    assert [one["doc"] for one in following.new()] == ["stop"]  # read_run names the other line
    folder.events.unlink()
    folder.events.mkdir()
    with pytest.raises(RunError, match="Is a directory"):
        Following(folder).new()


def test_following_a_shortened_journal_yields_nothing_until_new_lines_come(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    folder.events.write_bytes(_document("start") + _document("resume"))
    following = Following(folder)
    assert len(following.new()) == 2
    folder.events.write_bytes(_document("start"))
    assert following.new() == []
    folder.events.write_bytes(_document("start") + _document("resume") + _document("stop", status="done"))
    assert [one["doc"] for one in following.new()] == ["stop"]


def test_a_run_is_followed_until_its_end_or_until_its_writer_is_gone(tmp_path: Path) -> None:
    folder, waited = RunFolder(tmp_path), list[int]()

    def seen(coming: list[bytes]) -> list[str]:
        def wait() -> None:
            with folder.events.open("ab") as file:
                file.write(coming.pop(0))
            waited.append(1)

        return [one["doc"] for documents in followed(folder, wait) for one in documents]

    folder.events.write_bytes(_document("start"))
    assert (seen([]), waited) == (["start"], [])  # nobody is at it: killed
    with folder.owned():
        coming = [b"", _document("resume")[:9], _document("resume")[9:], _document("stop", status="done"), b"more"]
        assert seen(coming) == ["start", "resume", "stop"]
        assert (len(waited), coming) == (4, [b"more"])
        folder.events.write_bytes(_document("stop", status="aborted") + _document("resume"))
        assert seen([_document("stop", status="done")]) == ["stop", "resume", "stop"]


def test_rig_watch_shows_force_step_and_time_left(course: Course, tmp_path: Path) -> None:
    folder = RunFolder(tmp_path / "mine")
    folder.path.mkdir()
    seen = RunScreen(folder)
    start = {"doc": "start", "t_s": 100.0, "planned_indentations": 2, "subject": "S07", "virtual": True}
    documents = [
        {"doc": "event", "t_s": 110.0 + 10 * n, "stream": stream, "data": data}
        for n, (stream, data) in enumerate(EVENTS)
    ]
    seen.take([start])
    assert (seen.above(), seen.left_s, seen.now, seen.next) == (
        ["run     mine, subject S07, virtual bench"], None, "", "",
    )  # fmt: skip
    assert seen.below() == ["now     -", "next    -", "done    0 of 2, time left unknown"]
    seen.take(documents[:4])
    assert (seen.now, seen.left_s) == (FIRST, None)  # of the press that was begun: nothing else is known
    seen.take(documents[4:5])
    assert seen.now == FIRST
    seen.take(documents[5:6])
    assert seen.now == ""
    course.save(folder)
    seen.take([])
    assert (seen.now, seen.next, seen.left_s) == (REST, SECOND, 85.0)
    assert seen.below() == [f"now     {REST}", f"next    {SECOND}", "done    0 of 2, 0:01:25 left on the run's clock"]
    seen.take([*documents[6:12], {"doc": "event", "t_s": 223.0, "stream": "sample", "data": {"force_gwt": 2.0}}])
    assert (seen.now, seen.left_s) == (FIND, 22.0)
    assert seen.below()[-1] == "done    1 of 2, 0:00:22 left on the run's clock"
    assert seen.newest == {"force_gwt": 2.0}


def test_rig_watch_uses_the_new_timeline_of_a_resumed_run(course: Course, tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    course.save(folder)
    seen = RunScreen(folder)
    seen.take(
        [{"doc": "start", "t_s": 0.0}, {"doc": "event", "t_s": 10.0, "stream": EVENTS[0][0], "data": EVENTS[0][1]}]
    )
    assert (seen.now, seen.left_s) == (HOME, 135.0)
    seen.take([{"doc": "stop", "t_s": 12.0, "status": "aborted"}, {"doc": "resume", "t_s": 50.0}])
    assert (seen.now, seen.left_s) == ("", None)
    Course(30.0, {("home", 1, 0): 20.0}, {("home", 1, 0): "home"}).save(folder)
    seen.take([])
    assert (seen.now, seen.left_s) == ("home", 30.0)
    seen.take([{"doc": "event", "t_s": 60.0, "stream": "home", "data": {}}])
    assert (seen.now, seen.left_s) == ("", 10.0)


# --- the command ---


@pytest.fixture
def run(tmp_path: Path) -> Callable[[str], Path]:
    """A copy of an old run."""

    def copy(name: str) -> Path:
        return Path(shutil.copytree(OLD / name, tmp_path / name))

    return copy


def test_rig_watch_in_a_pipe_prints_one_line_per_event(program: Program, run: Callable[[str], Path]) -> None:
    folder = run("complete")
    ended = program("watch", folder)
    found = read_run(folder)
    lines = ended.out.splitlines()
    events = sorted((round(e["t_s"], 3), stream) for stream, them in found.events.items() for e in them)
    assert (ended.code, ended.err) == (0, "")
    assert len(lines) == len(events) + 3  # start, stop, and how it ended
    assert sorted((float(line[:10]), line.split()[1]) for line in lines[1:-2]) == events
    assert lines[0].startswith("     0.000  start               protocol bars_of_five, title Bar at five positions")
    assert lines[1] == "     0.000  mount               indentor bar:3.0"
    assert "unix_s" not in ended.out
    assert "None" not in ended.out
    assert lines[-1] == "state   done, 5 of 5 indentations"


def _stop(folder: Path) -> None:
    append(folder / "events.jsonl", {"doc": "stop", "t_s": 90.0, "status": "tripped", "reason": "too much"})


def test_rig_watch_ends_with_state_and_reason_of_a_killed_or_tripped_run(
    program: Program, run: Callable[[str], Path]
) -> None:
    folder = run("stopped")
    lines = program("watch", folder).out.splitlines()
    assert lines[-5] == "state   killed, 5 of 8 indentations"
    assert [line[:8].strip() for line in lines[-4:]] == ["because", "where", "next", "resume"]
    assert lines[-1] == f"resume  rig resume {folder}"
    _stop(folder)
    lines = program("watch", folder).out.splitlines()
    assert lines[-2:] == ["state   tripped, 5 of 8 indentations", "because too much"]


def test_rig_watch_json_reports_the_current_state(
    program: Program, run: Callable[[str], Path], course: Course
) -> None:
    folder = run("stopped")
    last = read_run(folder).stream("sample")[-1]
    told = program("watch", folder, "--json").json
    assert told == {
        "run": str(folder), "state": "killed", "done": 5, "planned": 8, "left_s": None,
        "now_text": None, "next_text": None,
        **{name: last[name] for name in ("force_gwt", "doi_mm", "x_mm", "height_mm", "phase")},
        "ending": told["ending"],
    }  # fmt: skip
    assert told["ending"]["resume"] == f"rig resume {folder}"
    course.save(RunFolder(folder))
    with RunFolder(folder).owned():
        told = program("watch", folder, "--json").json
    assert (told["state"], told["ending"], told["now_text"]) == ("running", None, SECOND)
    assert told["left_s"] > 0


@pytest.mark.parametrize(
    ("content", "named"),
    [
        (None, "events.jsonl: No such file or directory"),
        (b"noise\n", "line 1: not a journal document"),
        (b'{"doc": "start", "t_s": 0}\n{"doc": "event", "t_s": 0, "stream": "sample", "data": {}}\n',
         "KeyError: 'force_gwt'"),
    ],
)  # fmt: skip
def test_rig_watch_refuses_a_folder_without_a_run_in_one_line(
    program: Program, tmp_path: Path, content: bytes | None, named: str
) -> None:
    folder = tmp_path / "odd"
    folder.mkdir()
    if content is not None:
        (folder / "events.jsonl").write_bytes(content)
    ended = program("watch", folder, "--json")
    assert ended.code == 2
    assert str(folder) in ended.complaint
    assert named in ended.complaint
    assert (ended.error_code == "foreign_run") is ("KeyError" in named)
    plain = program("watch", folder)
    assert (plain.code, plain.err) == (2, ended.err)


def test_rig_watch_changes_no_file_of_a_run(program: Program, run: Callable[[str], Path]) -> None:
    folder = run("complete")

    def there() -> dict[str, tuple[int, bytes]]:
        return {path.name: (path.stat().st_mtime_ns, path.read_bytes()) for path in folder.iterdir()}

    before = there()
    program("watch", folder)
    program("watch", folder, "--json")
    assert there() == before


def test_rig_watch_shows_a_screen_on_a_terminal(
    program: Program, run: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    screen = io.StringIO()
    console = Console(file=screen, force_terminal=True, width=80, highlight=False, markup=False)
    monkeypatch.setattr(watch_command, "out", console)
    program("watch", run("complete"))
    drawn = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "\n", screen.getvalue())
    assert "run     complete, virtual bench\n" in drawn
    assert re.search(r"force   [\d.]+ gwt, depth [\d.]+ mm, x = .3\.00 mm, hold\n", drawn)
    assert "█" in drawn
    assert "done    5 of 5, 0:00:00 left on the run's clock\n" in drawn
    assert drawn.rstrip().endswith("state   done, 5 of 5 indentations")
    assert max(map(len, drawn.splitlines())) <= 80


def test_ctrl_c_in_rig_watch_leaves_the_run_running(
    program: Program, run: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(clock: WallClock, seconds: float) -> None:
        assert seconds == watch_command.LOOK_S == 0.2
        raise KeyboardInterrupt

    monkeypatch.setattr(WallClock, "wait_s", interrupted)
    folder = run("stopped")
    for terminal in (False, True):
        console = Console(file=io.StringIO(), force_terminal=terminal, highlight=False, markup=False)
        monkeypatch.setattr(watch_command, "out", console)
        with RunFolder(folder).owned():
            ended = program("watch", folder)
        assert (ended.code, ended.err) == (130, "stopped monitoring; the run continues\n")


# --- a run's own screen, and what it leaves for others ---

SCRIPT = """\
def run(rig):
    rig.mount("bar:3.0")
    rig.home()
    rig.zero()
    rig.move_to(x_mm=0.5)
    rig.indent(doi_mm=0.2, hold_s=0.1)
    rig.rest(1.5)
"""


@pytest.mark.usefixtures("empty_figures", "finger")
def test_a_run_on_a_terminal_shows_its_screen_and_stores_its_timeline(
    program: Program, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import rig.cli.progress as progress

    screen = io.StringIO()
    console = Console(file=screen, force_terminal=True, width=80, highlight=False, markup=False)
    for module in (output, progress):
        monkeypatch.setattr(module, "err", console)
    (tmp_path / "mine.py").write_text(SCRIPT, encoding="utf-8")
    told = program("dry-run", tmp_path / "mine.py", "--out", tmp_path / "runs", "--json").json
    folder = RunFolder(Path(told["run"]))
    course = Course.load(folder)
    assert course is not None
    assert list(course.words.values()) == [
        "mount bar:3.0", "home", "zero", "move to x = +0.50 mm", "press bar:3.0 at +0.50 mm to 0.2 mm", "rest 1.5 s",
    ]  # fmt: skip
    assert course.duration_s >= max(course.instants_s.values())
    assert "  timeline.json\n" in (folder.path / "SHA256SUMS").read_text(encoding="utf-8")
    drawn = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "\n", screen.getvalue())
    assert "now     mount bar:3.0\nnext    home\n" in drawn.replace("\r", "").replace("\n\n", "\n")
    assert "force   " in drawn
    assert max(map(len, drawn.splitlines())) <= 80
    seen = RunScreen(folder)
    seen.take(Following(folder).new())
    assert (seen.now, seen.next) == ("", "")
    assert seen.left_s == pytest.approx(0.0, abs=0.5)


def test_a_run_begins_without_a_predicted_timeline_and_on_a_full_disk(
    course: Course, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun = list[int]()
    folder = RunFolder(tmp_path)

    def attendant(of: Course | None) -> AtTheTerminal:
        return AtTheTerminal(pause=PauseRequest(), watch=print, begins=lambda: begun.append(1), course=of)  # type: ignore[arg-type]

    attendant(None).begins(folder)
    assert (begun, list(tmp_path.iterdir())) == ([1], [])

    def full(path: Path, text: str) -> None:
        raise UnwritableError.of(path, OSError(28, "No space left on device"))

    with monkeypatch.context() as patched:
        patched.setattr("rig.data.run_state.replace_text", full)
        attendant(course).begins(folder)
    assert (begun, list(tmp_path.iterdir())) == ([1, 1], [])
    attendant(course).begins(folder)
    assert Course.load(folder) == course


def test_the_live_screen_is_hidden_during_a_question(monkeypatch: pytest.MonkeyPatch) -> None:
    console = Console(file=io.StringIO(), force_terminal=True)
    monkeypatch.setattr(output, "err", console)
    shown: list[bool] = []

    class Answer:
        def readline(self) -> str:
            shown.append(live.is_started)
            return "yes\n"

    live: Live
    with a_screen(console, "drawn"):
        (live,) = output._screens
        with screen_aside():
            assert not live.is_started
        assert live.is_started
        monkeypatch.setattr("sys.stdin", Answer())
        assert ask_at_the_bench(Request("mount it")) == "yes\n"
        assert live.is_started
        pause = PauseRequest()
        monkeypatch.setattr(pause, "go_on", lambda meanwhile: shown.append(live.is_started) or True)
        assert AtTheTerminal(pause, print, print, None).go_on(print)  # type: ignore[arg-type]
    assert shown == [False, False]
    assert not output._screens
    with screen_aside():
        pass
