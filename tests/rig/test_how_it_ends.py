"""The program in a process of its own: Ctrl-C while it starts, a reader that goes, a disk that is full."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.waiting import DEADLINE_S

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
START = "from rig.cli import main; print('begun', file=sys.stderr, flush=True); main()"


def _started(*arguments: str) -> list[str]:
    return [sys.executable, "-c", f"import sys; {START}", *arguments]


@pytest.mark.parametrize("json_too", [False, True])
def test_ctrl_c_while_the_libraries_are_loaded(json_too: bool) -> None:
    """The signal comes while numpy is being looked for, which waits for it; typer has been loaded by then."""
    command = [sys.executable, "-c", f"{HELD_AT_NUMPY}\n{START}", "doctor", *(["--json"] if json_too else [])]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True) as process:
        assert process.stderr is not None
        assert [process.stderr.readline() for _ in range(2)] == ["begun\n", "loading\n"]
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=DEADLINE_S)
    line = "stopped at once by the operator"
    assert (process.returncode, err) == (130, f"rig: {line}\n")
    assert (json.loads(out) == {"error": line, "exit_code": 130}) if json_too else out == ""


@pytest.mark.parametrize("options", [["--help"], ["doctor"], ["doctor", "--json"]])
def test_a_reader_that_has_gone_ends_it_silently(options: list[str]) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    try:
        ended = subprocess.run(
            _started(*options), stdout=writer, stderr=subprocess.PIPE, text=True, timeout=DEADLINE_S, check=False
        )
    finally:
        os.close(writer)
    assert (ended.returncode, ended.stderr) == (1, "begun\n")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full, a device without space (Linux)")
@pytest.mark.parametrize("options", [["--help"], ["doctor"], ["doctor", "--json"]])
def test_a_full_disk_is_said(options: list[str]) -> None:
    with Path("/dev/full").open("w") as full:
        ended = subprocess.run(
            _started(*options), stdout=full, stderr=subprocess.PIPE, text=True, timeout=DEADLINE_S, check=False
        )
    begun, line = ended.stderr.splitlines()
    assert (ended.returncode, begun) == (2, "begun")
    assert line.startswith("rig: ")
    assert line.endswith(": No space left on device")
