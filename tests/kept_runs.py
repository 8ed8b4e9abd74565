"""Runs that version 0.3 wrote (tests/data/runs), and one of them as a kill left it."""

import atexit
import json
import os
import shutil
import tempfile
from pathlib import Path

from rig.data.documents import as_line

KEPT = Path(__file__).parent / "data" / "runs"
WHOLE_LINES, TORN_AT = 457, 60
"""Lines of the stopped run's journal, in indentation 5 of 8, and bytes of its torn last line."""


def _with_a_stopped_run() -> Path:
    folder = Path(tempfile.mkdtemp(prefix="rig-runs-"))
    made_by = os.getpid()
    atexit.register(lambda: os.getpid() == made_by and shutil.rmtree(folder, ignore_errors=True))
    shutil.copytree(KEPT, folder, dirs_exist_ok=True)
    stopped = shutil.copytree(KEPT / "complete_with_a_schedule", folder / "stopped")
    lines = (stopped / "events.jsonl").read_bytes().splitlines(keepends=True)
    start = as_line({**json.loads(lines[0]), "uid": "5" * 32})  # a run of its own, not a copy of the whole one
    (stopped / "events.jsonl").write_bytes(b"".join([start, *lines[1:WHOLE_LINES], lines[WHOLE_LINES][:TORN_AT]]))
    sums = (stopped / "SHA256SUMS").read_text("ascii").splitlines(keepends=True)
    kept = [line for line in sums if not line.endswith(("events.jsonl\n", "timeline.json\n"))]
    (stopped / "SHA256SUMS").write_text("".join(kept), "ascii")
    return folder


RUNS = _with_a_stopped_run()
"""A folder with complete, complete_with_a_schedule and stopped. Tests write to copies."""
