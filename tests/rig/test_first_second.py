"""What is seen of a command in its first second: its help, a word that it starts, a name that was mistyped."""

import json
import pkgutil
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from rig.cli import main
from rig.cli.error_exit_codes import BAD_INPUT, STOPPED, UNWRITABLE
from rig.cli.program import COMMANDS

OLD_RUN = Path(__file__).parents[1] / "data" / "runs" / "complete"
LIBRARIES = {
    "numpy",
    "scipy",
    "h5py",
    "matplotlib",
    "serial",
    "pymodbus",
    "rig.engine",
    "rig.plan",
    "sim",
}


def said(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, *words: str) -> tuple[int, str, str]:
    monkeypatch.setattr(sys, "argv", ["rig", *words])
    with pytest.raises(SystemExit) as ended:
        main()
    printed = capsys.readouterr()
    return int(ended.value.code or 0), " ".join(printed.out.split()), printed.err


SOLVES = {"scipy", "numba", "h5py", "matplotlib", "pymodbus", "asyncio", "PIL"}
PRESSES = SOLVES | {"sim.models.fingertip", "sim.plant"}
READS = LIBRARIES - {"rig.engine"} | {"rig.engine.engine"}
STOPS = LIBRARIES - {"serial"} | {"rig.data", "rig.protocol", "jinja2"}
# What a command is asked: a module that it imports, and those it must not wait for. A help takes the time that
# Python, typer and rich take; two hundred runs are listed in that time.
IMPORTS = {
    "--help": ("rig.cli.program", LIBRARIES | {"pydantic"}),
    "stop --help": ("rig.control.stop", STOPS),
    "runs .": ("rig.data.journal", READS),
    "show run": ("rig.data.journal", READS),
    "zero --help": ("rig.engine.engine", SOLVES | {"sim.contact"}),  # as home and status
    "panel --help": ("rig.manual.owner_process", SOLVES | {"sim.contact"}),
    "dry-run --help": ("rig.session.session", PRESSES),  # as check and resume
    "serve --help": ("sim.serve.prefetch", PRESSES),
}


ASKED = """\
import json, os, sys
from contextlib import suppress
from rig.cli import main

for words in json.loads(sys.argv[1]):
    if not os.fork():
        try:
            sys.argv = ["rig", *words.split()]
            os.dup2(os.open(os.devnull, os.O_RDWR), 1)
            with suppress(SystemExit):
                main()
            print(json.dumps([words, *sys.modules]), file=sys.stderr, flush=True)
        finally:
            os._exit(0)
    os.wait()
"""


@pytest.mark.skipif(sys.platform == "win32", reason="needs fork")
def test_a_command_imports_no_library_that_the_command_does_not_use(tmp_path: Path) -> None:
    """Each command is carried out where nothing but the command line has been imported."""
    shutil.copytree(OLD_RUN, tmp_path / "run")
    asked = [sys.executable, "-c", ASKED, json.dumps(list(IMPORTS))]
    ended = subprocess.run(asked, cwd=tmp_path, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=True)
    told = [json.loads(line) for line in ended.stderr.splitlines() if line.startswith("[")]
    imported = {words: set(modules) for words, *modules in told}
    assert list(imported) == list(IMPORTS)
    for words, (needed, unneeded) in IMPORTS.items():
        assert needed in imported[words], words
        assert imported[words] & unneeded == set(), words


def test_every_error_named_by_its_import_path_exists_under_that_path() -> None:
    for place in BAD_INPUT | STOPPED | UNWRITABLE:
        error = pkgutil.resolve_name(place)
        assert issubclass(error, Exception)
        assert f"{error.__module__}:{error.__qualname__}" == place


def test_rig_help_lists_every_command_with_the_line_of_its_own_help(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    code, all_of_them, _ = said(capsys, monkeypatch, "--help")
    assert code == 0
    for name, command in COMMANDS.items():
        assert (f"{name} {command.line}" in all_of_them) is not command.hidden
        code, its_own, _ = said(capsys, monkeypatch, name, "--help")
        assert code == 0
        assert f"Usage: rig {name} " in its_own
        assert command.line in its_own


@pytest.mark.parametrize(("typed", "meant"), [("dryrun", "dry-run"), ("resum", "resume")])
def test_a_mistyped_command_is_refused_with_the_nearest_command(
    typed: str, meant: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    code, _, complaint = said(capsys, monkeypatch, typed)
    assert code == 2
    assert complaint.count("\n") == 1
    assert f"{typed!r}; did you mean {meant}" in complaint


def test_a_command_after_two_dashes_is_carried_out(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It ended with 0 and had done nothing, a stop too."""
    code, _, complaint = said(capsys, monkeypatch, "--", "config", "no_such_key")
    assert code == 2
    assert complaint.startswith("rig: no_such_key: ")


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One that nobody has imported; it says what the collector of garbage did meanwhile."""
    (tmp_path / "newly_made.py").write_text("import gc\nlooking = gc.isenabled()\n", encoding="utf-8")
    (tmp_path / "broken_one.py").write_text("import gc\nraise KeyError(gc.isenabled())\n", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "newly_made", raising=False)
