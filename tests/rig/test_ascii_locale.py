"""A locale whose file names are ASCII: names that it cannot read are refused in one line, others work."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ASCII = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
ROOT = Path(__file__).parents[2]


@pytest.mark.skipif(sys.platform != "linux", reason="file names of other systems are Unicode")
@pytest.mark.parametrize(
    ("folder", "name", "code", "said"),
    [
        (".", "Prüfung B.py", 2, "set PYTHONUTF8=1"),
        ("Meßdaten", "mine.py", 2, "set PYTHONUTF8=1"),
        (".", "mine.py", 2, "cannot read events.jsonl"),
    ],
)
def test_a_file_name_that_the_locale_cannot_decode_is_refused_in_one_line(
    folder: str, name: str, code: int, said: str, tmp_path: Path
) -> None:
    """It ended in a traceback once the run folder existed."""
    here = tmp_path / folder
    here.mkdir(exist_ok=True)
    env = {**os.environ, **ASCII, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-m", "rig", "show", name], env=env, cwd=here, capture_output=True, text=True
    )
    assert done.returncode == code
    assert len(done.stderr.splitlines()) == 1
    assert said in done.stderr
