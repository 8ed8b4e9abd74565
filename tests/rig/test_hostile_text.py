"""Text from files, wires, names and scripts: it neither steers a terminal nor becomes a part of a page."""

import json
import shutil
import unicodedata
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import pytest
from rich.live import Live
from rich.table import Table
from rich.text import Text

from rig.cli import output, program
from rig.data import read_run
from rig.data.documents import as_line
from rig.printable import on_one_line, printable
from rig.report.run_report import write_report
from sim.models.fingertip import Fingertip
from tests.journals import rewrite
from tests.program import Program

STEERING = [chr(one) for one in range(0x110000) if unicodedata.category(chr(one)) in ("Cc", "Cf", "Cs", "Zl", "Zp")]
HOSTILE = "\x1b[2J\x1b]0;a\x07\r\b\x00\x9b31m\u202e\u2066\u2028\u2029\ud800\x7f<script>alert(1)</script>\nrig: fine"
RUN = Path(__file__).parents[1] / "data" / "runs" / "complete"


def steers(text: str) -> list[str]:
    """The characters of a printed text that would act on a terminal."""
    return [one for one in text if one in _STEERING and one != "\n"]


_STEERING = set(STEERING)


def test_every_control_character_is_printed_as_a_visible_escape() -> None:
    assert [one for one in STEERING if printable(f"a{one}b") == f"a{one}b"] == ["\t", "\n"]
    assert [one for one in STEERING if steers(printable(one)) and one != "\t"] == []
    for text in ("plain", "µm ≤ 5 … 3 × 4", "Zoë 指 中指", "a\tb\nc", "1\u202f000"):
        assert printable(text) == text
    assert printable("\x1b\r\x9b\u202e\ud800") == r"\x1b\r\x9b\u202e\ud800"
    assert on_one_line("a\nb\x07") == r"a\nb\x07"


WAYS: dict[str, Callable[[], object]] = {
    "result": lambda: output.out.print(HOSTILE),
    "progress": lambda: output.err.print(HOSTILE),
    "table": lambda: output.out.print(_table()),
    "styled text": lambda: output.out.print(Text(HOSTILE)),
    "live screen": lambda: _live(),
    "error": lambda: output.complain(HOSTILE),
    "activity": lambda: output._activities._say(output.Activity(HOSTILE)),
    "spinner": lambda: output.say_now(HOSTILE),
    "warning of the simulator": lambda: _warning(),
    "traceback": lambda: program._print_traceback(ValueError, ValueError(HOSTILE), None),
    "JSON": lambda: output.print_json({"a": HOSTILE}),
}


def _table() -> Table:
    table = Table(HOSTILE)
    table.add_row(HOSTILE)
    return table


def _live() -> None:
    with Live(Text(HOSTILE), console=output.out, auto_refresh=False) as live:
        live.refresh()


def _warning() -> None:
    import logging

    output.show_builds()
    logging.getLogger("sim").warning(
        "%s", HOSTILE.replace("\ud800", "")
    )  # pytest-xdist cannot send captured half pairs


@pytest.mark.parametrize("way", WAYS)
def test_no_output_function_passes_control_characters_to_the_terminal(
    capsys: pytest.CaptureFixture[str], way: str
) -> None:
    WAYS[way]()
    found = capsys.readouterr()
    assert found.out or found.err
    assert steers(found.out + found.err) == []
    if way == "JSON":
        assert found.out.isascii()
        assert json.loads(found.out) == {"a": HOSTILE}


def _changed(value: Any, key: str = "") -> Any:
    """A document whose free texts are hostile."""
    if isinstance(value, dict):
        return {name: _changed(one, name) for name, one in value.items()}
    if isinstance(value, list):
        return [_changed(one, key) for one in value]
    return HOSTILE if isinstance(value, str) and key in _FREE else value


_FREE = {"title", "source", "protocol", "controller", "sensor", "reason", "subject", "python", "stage", "force",
         "indentation-rig", "numpy", "text"}  # fmt: skip


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A run whose journal, versions and subject are hostile, in a folder of a hostile name."""
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "runs" / "run\x1b[31m\u202e"
    shutil.copytree(RUN, folder)
    lines = (folder / "events.jsonl").read_text(encoding="utf-8").splitlines()
    documents = [_changed(json.loads(line)) for line in lines]
    documents[0]["subject"] = HOSTILE
    note = {"uid": "n", "seq": 1, "t_s": 0.0, "unix_s": documents[0]["unix_s"], "stream": "note"}
    documents.insert(1, {"doc": "descriptor", **note, "units": {"text": ""}})
    documents.insert(2, {"doc": "event", **note, "data": {"text": HOSTILE}})
    numbered = [{**one, "seq": number} for number, one in enumerate(documents)]
    (folder / "events.jsonl").write_bytes(b"".join(map(as_line, numbered)))
    about = json.loads((folder / "provenance.json").read_text(encoding="utf-8"))
    (folder / "provenance.json").write_text(json.dumps(_changed(about)), encoding="utf-8")
    (folder / "SHA256SUMS").unlink()
    return folder


COMMANDS: dict[str, tuple[str, ...]] = {
    "show": ("show", "RUN"),
    "list": ("runs",),
    "list as JSON": ("runs", "--json"),
    "monitor": ("monitor", "RUN"),
    "export": ("export", "RUN", "--csv"),
    "no such command": (f"x{HOSTILE}",),
    "no such file": ("check", "bars", "--config", f"x{HOSTILE.replace(chr(0), '')}"),
    "a configuration": ("check", "bars", "--config", "hostile.toml"),
    "a script": ("check", "hostile.py"),
}


@pytest.mark.parametrize("command", COMMANDS)
def test_no_command_passes_control_characters_to_the_terminal(run: Path, program: Program, command: str) -> None:
    Path("hostile.toml").write_text('["\\u001b[2J\\u202e"]\na = 1\n', encoding="utf-8")
    script = "def run(rig):\n    raise ValueError('\\x1b[2J\\u202e')\n"
    Path("hostile.py").write_text(script, encoding="utf-8")
    ended = program(*(word.replace("RUN", str(run)) for word in COMMANDS[command]))
    assert ended.out or ended.err
    assert steers(ended.out + ended.err) == []
    if "JSON" in command:
        assert ended.out.isascii()
    if command in ("show", "list", "monitor"):
        assert not [line for line in ended.out.splitlines() if line.startswith("rig: fine")]


def test_pages_and_tables_escape_hostile_text(run: Path, program: Program, finger: Fingertip) -> None:
    journal = run / "events.jsonl"
    lines = journal.read_text(encoding="utf-8").splitlines(keepends=True)
    first = next(n for n, line in enumerate(lines) if '"indentation_start"' in line)
    journal.write_text("".join(lines[:first]), encoding="utf-8")
    page = write_report(read_run(run), finger).read_text(encoding="utf-8")
    assert "<script>alert" not in page
    assert steers(page) == []
    assert program("export", str(run), "--csv").code == 0
    with h5py.File(run / "data.h5") as file:
        assert len(file) > 0


def test_export_refuses_a_stream_name_that_is_a_path(run: Path, program: Program) -> None:
    journal = run / "events.jsonl"
    rewrite(journal, lambda one: {**one, "stream": "../../note"} if one.get("stream") == "note" else one)
    ended = program("export", str(run), "--csv", "--json")
    assert (ended.code, ended.json["code"]) == (2, "bad_journal")
    assert not list(run.parents[1].glob("*.csv"))
