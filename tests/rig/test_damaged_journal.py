"""A damaged journal: the line is named, sound presses stay, and nothing that decides a press is taken from it."""

import errno
import json
import os
import shutil
import threading
from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any

import pytest

from rig.cli.script_execution import RunOwner
from rig.data import Run, read_run
from rig.data.documents import as_line, fits, read_lines
from rig.data.folder import PLAN, RunFolder
from rig.data.journal import add_to_end, mend_journal
from rig.data.tables import LISTED, summary_of
from rig.plan.config import Config
from rig.plan.plan import make_plan
from rig.protocol.script import load_script
from rig.session.session import NewRun, Session, dry_run
from sim.models.fingertip import Fingertip
from tests.program import Program
from tests.waiting import until

pytestmark = pytest.mark.usefixtures("empty_figures", "cheap_measures")

SCRIPT = """\
def run(rig):
    rig.mount("bar:3.0")
    rig.home()
    rig.zero()
    for x_mm in (-0.5, 0.0, 0.5):
        rig.move_to(x_mm=x_mm)
        rig.indent(force_gwt=1.0, hold_s=0.1)
"""
Lines = list[bytes]


@pytest.fixture(autouse=True)
def no_strain_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Strain under the deepest press takes longer than all else; damage is named before it."""
    monkeypatch.setattr("rig.report.strain_figure.strain_figures", lambda *_: ())


Spoil = Callable[[Lines, int], object]


@pytest.fixture(scope="module")
def whole(finger: Fingertip, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("whole")
    path = folder / "three.py"
    path.write_text(SCRIPT, encoding="utf-8")
    script = load_script(str(path))
    plan = make_plan(script, Config(), finger)
    done = dry_run(Session(script, Config(), finger, plan, NewRun(folder / "runs")))
    assert done.complete, done.problem
    return done.folder.path


@pytest.fixture
def folder(whole: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(whole, tmp_path / "runs" / whole.name))


def _lines(folder: Path) -> Lines:
    return (folder / "events.jsonl").read_bytes().splitlines(keepends=True)


def _number(lines: Lines, stream: str, index: int) -> int:
    """Position of the first event of a press in a stream."""
    found = [json.loads(line) for line in lines]
    return next(
        n for n, one in enumerate(found) if one.get("stream") == stream and one.get("data", {}).get("index") == index
    )


def _changed_bit(lines: Lines, n: int) -> None:
    at = lines[n].rindex(b"0")
    lines[n] = lines[n][:at] + b"1" + lines[n][at + 1 :]


SPOILS: dict[str, Spoil] = {
    "one digit changed": _changed_bit,
    "dropped": lambda lines, n: lines.pop(n),
    "doubled": lambda lines, n: lines.insert(n, lines[n]),
    "swapped with the next": lambda lines, n: lines.insert(n + 1, lines.pop(n)),
    "not a document": lambda lines, n: lines.__setitem__(n, b"rubbish\n"),
    "a foreign line before it": lambda lines, n: lines.insert(n, b'{"level": "info", "msg": "sync"}\n'),
    "a line without a checksum before it": lambda lines, n: lines.insert(
        n, b'{"doc": "event", "t_s": 1.0, "stream": "note", "data": {"text": "by hand"}}\n'
    ),
    "an overlong line before it": lambda lines, n: lines.insert(n, b"x" * 5_000_000 + b"\n"),
}
"""What happens to a line of the journal."""
PLACES = ("indentation_start", "sample", "touch", "hold_end", "indentation_end")
"""Events of the second press; its neighbors are sound."""


@pytest.mark.parametrize(
    ("what", "place"),
    [*((what, "touch") for what in SPOILS), *(("one digit changed", place) for place in PLACES if place != "touch")],
)
def test_reading_a_damaged_journal_omits_the_damaged_press_and_keeps_the_others(
    folder: Path, what: str, place: str
) -> None:
    lines = _lines(folder)
    SPOILS[what](lines, n := _number(lines, place, 1))
    (folder / "events.jsonl").write_bytes(b"".join(lines))
    run = read_run(folder)
    assert n + 1 <= run.damage[0].line <= n + 2
    assert run.warning is not None
    assert f"line {run.damage[0].line}" in run.warning
    assert set(run.done) <= {0, 1, 2}
    assert {0, 2} - {2 if place == "indentation_end" else 0} <= set(run.done)
    if what in ("one digit changed", "dropped", "not a document"):
        assert 1 not in run.done
    for events in run.events.values():
        assert all(event.get("index") not in run.damaged for event in events)
    listed = summary_of(read_run(folder, only=LISTED))  # as `rig runs` reads it
    assert (listed.done, listed.state) == (len(run.done), summary_of(run).state)


@pytest.mark.parametrize(
    ("spoil", "left"),
    [
        (lambda text: text.replace(b"\n", b"\r\n"), "; 0 of 3 presses can be read"),
        (lambda text: text.decode().encode("utf-16"), "; 0 of 3 presses can be read"),
        (lambda text: text.replace(b'"title": "', b'"title": "a ', 1), "; no press is left out"),
    ],
    ids=["CRLF", "UTF-16", "the first line alone"],
)
def test_a_damaged_journal_says_how_many_presses_can_be_read(
    spoil: Callable[[bytes], bytes], left: str, folder: Path
) -> None:
    journal = folder / "events.jsonl"
    journal.write_bytes(spoil(journal.read_bytes()))
    assert left in str(read_run(folder).warning)
    assert left in summary_of(read_run(folder, only=LISTED)).damage


def test_the_checksum_of_each_journal_line_detects_any_changed_bit(folder: Path) -> None:
    lines = _lines(folder)
    assert all(fits(line.rstrip(b"\n")) for line in lines)
    assert [json.loads(line)["seq"] for line in lines] == list(range(len(lines)))
    for line in lines[:40]:
        for at in range(0, len(line) - 1, 7):
            other = bytes([line[at] ^ 1])
            assert not fits((line[:at] + other + line[at + 1 :]).rstrip(b"\n"))


@pytest.mark.parametrize("command", [("show",), ("export", "--csv"), ("export", "--report"), ("watch",), ("resume",)])
def test_every_command_that_reads_a_run_names_its_damaged_line(
    program: Program, folder: Path, command: tuple[str, ...]
) -> None:
    lines = _lines(folder)
    lines[_number(lines, "hold_end", 1)] = b"rubbish\n"
    (folder / "events.jsonl").write_bytes(b"".join(lines))
    name, *options = command
    ended = program(name, folder, *options)
    assert ended.code == 0, ended.err
    damage = read_run(folder).damage[0]
    assert f"line {damage.line}: {damage.problem}" in ended.err
    if name == "resume":
        run = read_run(folder)
        assert (sorted(run.done), run.missing) == ([0, 1, 2], 0)


PRINT_THE_STATE = ("show", "watch")  # of any run
READERS = (*PRINT_THE_STATE, "export --csv", "export --report", "nerve --afferents SA1@0", "find", "compare")


@pytest.mark.parametrize("command", READERS)
@pytest.mark.parametrize("cut", [True, False])
def test_every_command_that_reads_a_run_says_once_if_its_journal_is_cut_off(
    program: Program, folder: Path, command: str, cut: bool
) -> None:
    """Before any work on the run, of which this one has nothing to work with."""
    lines = _lines(folder)
    if cut:
        (folder / "events.jsonl").write_bytes(b"".join(lines[: _number(lines, "hold_end", 1)])[:-20])
    (folder / "config.toml").unlink()
    name, *options = command.split()
    ended = program(name, folder, *options)
    said = [line for line in (ended.out + ended.err).splitlines() if "killed" in line and "1 of 3" in line]
    assert len(said) == cut, ended.out + ended.err
    assert all((line in ended.out) is (name in PRINT_THE_STATE) for line in said)


INPUTS = ("config.toml", "protocol.py", "provenance.json", PLAN, "beside.py", "shape_map.npy")


@pytest.mark.parametrize(
    ("command", "file"), [*((one, "config.toml") for one in READERS), *product(["show"], INPUTS)]
)
def test_every_command_that_reads_a_run_names_the_stored_file_that_has_changed(
    program: Program, folder: Path, command: str, file: str
) -> None:
    """Before any work with it; an export of the data does not make it the run's."""
    about = json.loads((folder / "provenance.json").read_text("utf-8"))
    (folder / "provenance.json").write_text(json.dumps({**about, "beside": ["beside.py"]}), encoding="utf-8")
    for name in ("beside.py", "shape_map.npy"):
        (folder / name).touch()
    (folder / "SHA256SUMS").unlink()
    RunFolder(folder).write_checksums(new=True)
    text = (folder / file).read_text("utf-8")
    (folder / file).write_text(
        f"{text[:-1]} {text[-1:]}" if file.endswith("json") else f"{text}\n[", encoding="utf-8"
    )
    name, *options = command.split()
    for _ in range(2):
        ended = program(name, folder, *options)
        (said,) = (line for line in ended.err.splitlines() if "since the run began" in line)
        assert f"{file} changed" in said


@pytest.mark.parametrize("lost", ["SHA256SUMS", "a line of it"])
@pytest.mark.parametrize("command", READERS)
def test_every_command_that_reads_a_run_says_what_cannot_be_verified(
    program: Program, folder: Path, command: str, lost: str
) -> None:
    """Whether a file was edited is not known without its checksum, and is no proof that it was not."""
    sums = folder / "SHA256SUMS"
    lines = sums.read_text("utf-8").splitlines(keepends=True)
    sums.unlink()
    if lost == "a line of it":
        sums.write_text("".join(line for line in lines if "config.toml" not in line), encoding="utf-8")
    name, *options = command.split()
    for _ in range(2):  # an export writes other checksums
        ended = program(name, folder, *options)
        (said,) = (line for line in ended.err.splitlines() if "cannot be verified" in line)
        assert "config.toml" in said
        assert ("protocol.py" in said) is (lost == "SHA256SUMS")


@pytest.mark.parametrize("options", [(), ("--table", "all.csv"), ("--json",)])
@pytest.mark.parametrize("what", ["dropped", "one digit changed", "not a document", "saved with other line ends"])
def test_rig_runs_names_the_damage_of_each_journal(
    program: Program, folder: Path, tmp_path: Path, what: str, options: tuple[str, ...]
) -> None:
    """Also the second time, when it comes from the index."""
    lines = _lines(folder)
    if what in SPOILS:
        SPOILS[what](lines, _number(lines, "hold_end", 1))
    else:
        lines = [line.replace(b"\n", b"\r\n") for line in lines]
    (folder / "events.jsonl").write_bytes(b"".join(lines))
    damage = read_run(folder).damage[0]
    for _ in range(2):
        ended = program("runs", folder.parent, *(str(tmp_path / one) if "." in one else one for one in options))
        assert ended.code == 0, ended.err
        assert f"events.jsonl is damaged, line {damage.line}: {damage.problem}" in ended.err
        if options == ("--json",):
            assert ended.json["runs"][0]["damage_text"] in ended.err


@pytest.mark.parametrize("spoil", [_changed_bit, lambda lines, n: lines.pop(n)])
def test_a_run_with_a_damaged_first_line_is_not_resumed_and_its_journal_stays_as_it_was(
    program: Program, folder: Path, spoil: Spoil
) -> None:
    lines = _lines(folder)[:-3]
    spoil(lines, 0)
    (folder / "events.jsonl").write_bytes(b"".join(lines))
    ended = program("resume", folder, "--json")
    assert ended.code == 2
    assert ended.json["code"] in ("start_damaged", "no_start")
    assert "line 1" in ended.err or "start document" in ended.err
    assert _lines(folder) == lines


def test_a_soft_trip_changed_in_the_start_document_is_refused(program: Program, folder: Path) -> None:
    """One wrong bit: 0.02 → 1.02 N."""
    lines = _lines(folder)[:-3]
    start = json.loads(lines[0])
    changed = json.dumps(start["soft_trip_n"])
    lines[0] = lines[0].replace(f'"soft_trip_n": {changed}'.encode(), f'"soft_trip_n": 1{changed[1:]}'.encode())
    (folder / "events.jsonl").write_bytes(b"".join(lines))
    ended = program("resume", folder, "--json")
    assert (ended.code, ended.json["code"]) == (2, "start_damaged")


def _as_of_0_2(lines: Lines, soft_trip_n: float | None = None) -> bytes:
    """Documents without checksums, as version 0.2 wrote them."""
    documents = [{key: value for key, value in json.loads(line).items() if key != "crc32"} for line in lines]
    if soft_trip_n is not None:
        documents[0]["soft_trip_n"] = soft_trip_n
    return b"".join(json.dumps(document).encode() + b"\n" for document in documents)


def test_a_journal_of_0_2_is_resumed_only_with_the_soft_trip_of_its_plan(program: Program, folder: Path) -> None:
    lines = _lines(folder)
    half = lines[: _number(lines, "indentation_start", 1) + 3]
    (folder / "events.jsonl").write_bytes(_as_of_0_2(half, soft_trip_n=1.15))
    assert read_run(folder).damage == []
    ended = program("resume", folder, "--json")
    assert (ended.code, ended.json["code"]) == (2, "other_soft_trip")
    (folder / "events.jsonl").write_bytes(_as_of_0_2(half))
    assert program("resume", folder).code == 0
    run = read_run(folder)
    assert (run.missing, run.repeated, run.complete) == (0, 0, True)


def test_an_appended_journal_line_continues_the_sequence_numbers(folder: Path) -> None:
    path, count = folder / "events.jsonl", len(_lines(folder))
    assert mend_journal(path) == count
    add_to_end(path, {"stopped_while": "reporting"}, 1.0)
    *_, last = read_lines(path)
    assert last.damage is None
    assert last.document is not None
    assert (last.document["seq"], last.document["stopped_while"]) == (count, "reporting")
    assert fits(as_line(last.document).rstrip(b"\n"))


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="has no /dev/zero")
@pytest.mark.parametrize("command", [("resume",), ("export", "--csv")])
def test_a_journal_that_is_a_link_to_an_endless_device_is_refused(
    program: Program, folder: Path, command: tuple[str, ...]
) -> None:
    (folder / "events.jsonl").unlink()
    os.symlink("/dev/zero", folder / "events.jsonl")
    name, *options = command
    ended = program(name, folder, *options, "--json")
    assert ended.code == 2
    assert "a device instead of a regular file" in ended.err


KEYS = ("index", "t_s", "data", "indentor", "doc")


@pytest.mark.parametrize("key", KEYS)
@pytest.mark.parametrize("command", [("export", "--report"), ("resume",)])
def test_one_changed_key_of_a_journal_without_checksums_gives_one_line_of_error(
    program: Program, folder: Path, key: str, command: tuple[str, ...]
) -> None:
    text = _as_of_0_2(_lines(folder)).decode().replace(f'"{key}"', f'"{key}_"')
    (folder / "events.jsonl").write_text(text, encoding="utf-8")
    name, *options = command
    ended = program(name, folder, *options)
    assert ended.code in (0, 2)
    assert "Traceback" not in ended.err
    if ended.code:
        assert str(folder) in ended.err.splitlines()[-1]


# --- the disk, and files that fail ---


def test_a_run_that_the_disk_cannot_hold_is_refused_before_anything_moves(
    program: Program, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    script = tmp_path / "three.py"
    script.write_text(SCRIPT, encoding="utf-8")
    usage = shutil.disk_usage(tmp_path)
    words = ("dry-run", script, "--out", tmp_path / "out", "--json")
    monkeypatch.setattr(shutil, "disk_usage", lambda path: usage._replace(free=1_000_000))
    ended = program(*words)
    assert (ended.code, ended.error_code) == (2, "disk_full")
    assert not (tmp_path / "out").exists()
    monkeypatch.setattr(shutil, "disk_usage", lambda path: usage._replace(free=20_000_000))
    assert program(*words).code == 0


AFTER_THE_LAST_MOTION = {
    "the journal is read": "rig.session.session.read_run",
    "the export": "rig.session.session.export_run",
    "the report": "rig.cli.script_execution.make_report",
    "the checksums": "rig.data.folder.RunFolder.write_checksums",
}


@pytest.mark.parametrize("what", AFTER_THE_LAST_MOTION)
@pytest.mark.parametrize(
    ("failure", "trips"),
    [(RuntimeError("no usable backend"), True), (MemoryError(), False), (OSError(errno.ENOSPC, "full"), True)],
)
def test_a_failure_after_the_last_motion_never_replaces_the_reason_a_run_ended(
    program: Program, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, what: str, failure: Exception, trips: bool
) -> None:
    script = tmp_path / "three.py"
    once = SCRIPT.replace("(-0.5, 0.0, 0.5)", "(0.0,)")
    # Only the run itself has a journal: planned and rehearsed it ends well.
    stops = f"    if list(Path({str(tmp_path)!r}).glob('out/*/events.jsonl')):\n        1 / 0\n"
    script.write_text(f"from pathlib import Path\n{once}{stops if trips else ''}", encoding="utf-8")

    def fails(*about: Any, **__: object) -> None:
        if what != "the checksums" or (about[0].path / "bytes.jsonl").exists():
            raise failure

    monkeypatch.setattr(AFTER_THE_LAST_MOTION[what], fails)
    ended = program("dry-run", script, "--out", tmp_path / "out", "--json")
    assert ended.code == (1 if trips else 2), ended.err
    assert "Traceback" not in ended.err
    assert "no_traceback" not in ended.err
    answer = ended.json
    assert answer["indentations"] == 1
    if not isinstance(failure, OSError) or what == "the journal is read":
        assert "rig export" in answer["files_text"]
    if trips:
        assert answer["ending"]["indentor"]["left"] == "lifted"
        assert "division by zero" in answer["ending"]["reason_text"]


def test_a_stop_during_the_report_after_a_trip_leaves_the_reason_of_the_trip(
    program: Program, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    script, screw, before = tmp_path / "three.py", tmp_path / "rig.toml", dict[str, Any]()
    script.write_text(SCRIPT, encoding="utf-8")
    screw.write_text("[virtual]\nz_screw_steps_per_mm = 460\n", encoding="utf-8")  # It does not reach the skin.
    owners: list[RunOwner] = []

    class Noted(RunOwner):
        def __init__(self, *about: Any, **more: Any) -> None:
            super().__init__(*about, **more)
            owners.append(self)

    def stopped(_: object, run: Run, *more: object) -> None:
        before.update(run.stop or {})
        threading.Thread(target=owners[0].answers["stop"], args=({"by": "panel"},)).start()
        until(lambda: False)

    monkeypatch.setattr("rig.cli.script_execution.RunOwner", Noted)
    monkeypatch.setattr("rig.cli.script_execution.make_report", stopped)
    ended = program("dry-run", script, "--config", screw, "--out", tmp_path / "out", "--json")
    answer, after = ended.json, read_run(Path(ended.json["run"])).stop
    assert after is not None
    assert (ended.code, answer["code"], before["status"]) == (1, "no_contact", "tripped")
    assert after["stopped_while"] == "reporting"
    assert {name for name in after if after[name] != before.get(name)} == {
        *("uid", "seq", "unix_s", "stopped_while", "crc32")
    }
    assert before["reason"] in answer["ending"]["reason_text"]
    assert "from the panel" not in answer["ending"]["reason_text"]
