"""Runs that version 0.3 wrote (tests/data/runs); one of them as a kill left it, which is made from a whole one."""

import json
import shutil
import tempfile
from pathlib import Path

from rig.data.documents import as_line

RUNS = Path(__file__).parent / "data" / "runs"
WHOLE_LINES, TORN_AT = 457, 60
"""Lines of the stopped run's journal, in indentation 5 of 8, and bytes of its torn last line."""


def make_stopped_run() -> None:
    """Make tests/data/runs/stopped, unless it is there."""
    whole, target = RUNS / "complete_with_a_schedule", RUNS / "stopped"
    lines = (whole / "events.jsonl").read_bytes().splitlines(keepends=True)
    start = as_line({**json.loads(lines[0]), "uid": "5" * 32})  # a run of its own, not a copy of the whole one
    journal = b"".join([start, *lines[1:WHOLE_LINES], lines[WHOLE_LINES][:TORN_AT]])
    if target.exists() and (target / "events.jsonl").read_bytes() == journal:
        return
    stopped = Path(tempfile.mkdtemp(dir=RUNS, prefix=".stopped-"))
    shutil.copytree(whole, stopped, dirs_exist_ok=True)
    (stopped / "events.jsonl").write_bytes(journal)
    sums = (stopped / "SHA256SUMS").read_text("ascii").splitlines(keepends=True)
    kept = [line for line in sums if not line.endswith(("events.jsonl\n", "timeline.json\n"))]
    (stopped / "SHA256SUMS").write_text("".join(kept), "ascii")
    shutil.rmtree(target, ignore_errors=True)
    try:
        stopped.replace(target)
    except OSError:  # another session has just made it
        shutil.rmtree(stopped)
