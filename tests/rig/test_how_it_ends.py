"""The program in a process of its own: Ctrl-C while it starts, a reader that goes, a disk that is full."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

START = "from rig.cli import main; print('begun', file=sys.stderr, flush=True); main()"


def _started(*arguments: str) -> list[str]:
    return [sys.executable, "-c", f"import sys; {START}", *arguments]


@pytest.mark.parametrize("json_too", [False, True])
def test_ctrl_c_while_the_libraries_are_loaded(json_too: bool) -> None:
    """The first import after `begun` takes half a second or more; the signal comes in a tenth of that."""
    command = _started("doctor", *(["--json"] if json_too else []))
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        assert process.stderr.readline() == "begun\n"
        time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=30)
    line = "stopped at once by the operator"
    assert (process.returncode, err) == (130, f"rig: {line}\n")
    assert (json.loads(out) == {"error": line, "exit_code": 130}) if json_too else out == ""


@pytest.mark.parametrize("options", [["--help"], ["doctor"], ["doctor", "--json"]])
def test_a_reader_that_has_gone_ends_it_silently(options: list[str]) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    try:
        ended = subprocess.run(
            _started(*options), stdout=writer, stderr=subprocess.PIPE, text=True, timeout=60, check=False
        )
    finally:
        os.close(writer)
    assert (ended.returncode, ended.stderr) == (1, "begun\n")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full, a device without space (Linux)")
@pytest.mark.parametrize("options", [["--help"], ["doctor"], ["doctor", "--json"]])
def test_a_full_disk_is_said(options: list[str]) -> None:
    with Path("/dev/full").open("w") as full:
        ended = subprocess.run(
            _started(*options), stdout=full, stderr=subprocess.PIPE, text=True, timeout=60, check=False
        )
    begun, line = ended.stderr.splitlines()
    assert (ended.returncode, begun) == (2, "begun")
    assert line.startswith("rig: ")
    assert line.endswith(": No space left on device")
