"""The program in a process of its own: Ctrl-C while it starts, a reader that goes, a disk that is full."""

import errno
import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from sim.models.fingertip import Fingertip
from tests.preloaded import Popen
from tests.program import EMPTY_FIGURES, Program, beside_progress
from tests.waiting import DEADLINE_S, until

pytestmark = pytest.mark.usefixtures("empty_figures")

HELD_AT_NUMPY = """\
import sys

class Held:
    @staticmethod
    def find_spec(name, path=None, target=None):
        if name == "numpy":
            print("loading", file=sys.stderr, flush=True)
            sys.stdin.read()

sys.meta_path.insert(0, Held)
"""
OWN_TERMINAL = "import fcntl, sys, termios; fcntl.ioctl(0, termios.TIOCSCTTY, 0)"
START = "from rig.cli import main; print('begun', file=sys.stderr, flush=True); main()"


# The last one writes unbuffered; of the others, what remains is written when the interpreter ends.
OUTPUTS = pytest.mark.parametrize(("options", "unbuffered"), [("--help", ""), ("doctor --json", "1")])


def _ended(options: str, unbuffered: str, out: int) -> tuple[int, str]:
    """The exit code of a command whose output goes there, and its standard error."""
    command = [sys.executable, "-c", f"import sys; {START}", *options.split()]
    env = {**os.environ, "PYTHONUNBUFFERED": unbuffered}
    with subprocess.Popen(command, stdout=out, stderr=subprocess.PIPE, text=True, env=env) as process:
        err = process.communicate(timeout=DEADLINE_S)[1]
    return process.returncode, err


def test_ctrl_c_while_libraries_load_ends_the_program_in_one_line() -> None:
    """The signal comes while numpy is being looked for, which waits for it; typer has been loaded by then."""
    command = [sys.executable, "-c", f"{HELD_AT_NUMPY}\n{START}", "doctor", "--json"]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True) as process:
        assert process.stderr is not None
        assert beside_progress("".join(iter(process.stderr.readline, "loading\n"))) == "begun\n"
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=DEADLINE_S)
    err = beside_progress(err)
    line = err.removeprefix("rig: ").removesuffix("\n")
    assert (process.returncode, err.count("\n"), bool(line)) == (130, 1, True)
    told = {"error_text": line, "code": "interrupted", "exit_code": 130}
    assert json.loads(out) == told


@OUTPUTS
def test_a_closed_output_pipe_ends_the_program_without_a_message(options: str, unbuffered: str) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    try:
        code, err = _ended(options, unbuffered, writer)
    finally:
        os.close(writer)
    assert (code, beside_progress(err)) == (1, "begun\n")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full, a device without space (Linux)")
@OUTPUTS
def test_an_output_on_a_full_disk_ends_the_program_with_one_line(options: str, unbuffered: str) -> None:
    with Path("/dev/full").open("w") as full:
        code, err = _ended(options, unbuffered, full.fileno())
    begun, line = beside_progress(err).splitlines()
    assert (code, begun) == (2, "begun")
    assert line.startswith("rig: ")
    assert line.endswith(os.strerror(errno.ENOSPC))


# --- the terminal goes away ---

THREE = """\
def run(rig):
    rig.mount("bar:3.0")
    rig.home()
    rig.zero()
    for x_mm in (-0.5, 0.0, 0.5):
        rig.move_to(x_mm=x_mm)
        rig.indent(doi_mm=0.2, hold_s=8.0 if x_mm < 0 else 0.1)
"""


def _journal(out: Path) -> list[dict[str, Any]]:
    return [
        json.loads(line) for path in out.glob("*/events.jsonl") for line in path.read_text().splitlines(True)[:-1]
    ]


@pytest.mark.parametrize("way", ["terminal", "SIGTERM"])
def test_a_run_whose_terminal_closes_lifts_and_can_be_resumed(
    way: str, finger: Fingertip, program: Program, tmp_path: Path
) -> None:
    """In a hold: the master of its pseudo-terminal is closed, or the signal sent. Nobody is left to be told."""
    script, out = tmp_path / "three.py", tmp_path / "out"
    script.write_text(THREE, encoding="utf-8")
    master, terminal = os.openpty()
    command = [
        sys.executable,
        "-c",
        f"{OWN_TERMINAL}\n{EMPTY_FIGURES}{START}",
        "dry-run",
        str(script),
        "--out",
        str(out),
    ]
    process = Popen(
        [*command, "--speed", "40"],
        stdin=terminal, stdout=terminal, stderr=terminal, start_new_session=True,
    )  # fmt: skip
    os.close(terminal)
    try:
        until(lambda: any(d.get("stream") == "hold_start" for d in _journal(out)) or process.poll() is not None)
        if way == "terminal":
            os.close(master)
        else:
            process.send_signal(getattr(signal, way))
            if way == "SIGTERM":  # which pauses: Ctrl-D is nobody's Enter
                until(lambda: b"press Enter to continue" in os.read(master, 4096))
                os.write(master, b"\x04")
        assert process.wait(timeout=DEADLINE_S) == 130
    finally:
        process.kill()
        process.wait()
        if way != "terminal":
            os.close(master)
    (folder,) = out.iterdir()
    told = [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()]
    assert [d["stream"] for d in told if d["doc"] == "event"][-2:] == ["retract", "paused"]
    assert (told[-1]["doc"], told[-1]["status"]) == ("stop", "aborted")
    assert (folder / "report.html").exists()
    assert (told[-1]["indentor"]["left"], told[-1]["indentor"]["may_touch"]) == ("lifted", False)
    assert f"rig resume {folder}" in (folder / "report.html").read_text(encoding="utf-8")
    again = program("resume", folder, "--json")
    assert again.code == 0, again.err
    assert {k: again.json[k] for k in ("complete", "missing", "repeated")} == {
        "complete": True, "missing": 0, "repeated": 0,
    }  # fmt: skip
