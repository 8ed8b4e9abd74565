"""What a journal that was taken up says of the whole run, on documents written by hand."""

import json
from pathlib import Path
from typing import Any

from rig.data import read_run


def event(t_s: float, stream: str, **data: Any) -> dict[str, Any]:
    return {"doc": "event", "t_s": t_s, "stream": stream, "data": data}


def test_a_run_that_was_taken_up_and_did_a_press_twice(tmp_path: Path) -> None:
    documents = [
        {"doc": "start", "t_s": 0.0, "planned_indentations": 1},
        event(1.0, "indentation_start", index=0, increments=1),
        event(2.0, "hold_end", index=0, hold=1, contact_s=3.5),
        {"doc": "resume", "t_s": 100.0},
        event(101.0, "indentation_start", index=0, increments=1),
        event(102.0, "hold_end", index=0, hold=1),
        {"doc": "stop", "t_s": 103.0, "status": "done"},
    ]
    (tmp_path / "events.jsonl").write_text("".join(json.dumps(d) + "\n" for d in documents), encoding="utf-8")
    run = read_run(tmp_path)
    assert (run.missing, run.repeated, run.restarted) == (0, 1, 1)
    assert run.duration_s == (2.0 - 0.0) + (103.0 - 100.0)  # not the time between
    assert run.contact_s == 3.5  # also of what was begun again
    (tmp_path / ".lock").touch()
    run.folder.write_checksums()
    assert [line.split("  ")[1] for line in (tmp_path / "SHA256SUMS").read_text().splitlines()] == ["events.jsonl"]
