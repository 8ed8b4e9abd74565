"""How the last real run on a stage left its indentor, from the folders of runs; folders of a few lines."""

import json
from pathlib import Path
from typing import Any

import pytest

from rig.data.folder import FolderBusyError, RunFolder
from rig.plan.config import Config
from rig.session.resume import last_ending

HERE = Config.model_validate({"stage": {"port": "here"}})
HELD = {"left": "held", "may_touch": True, "x_mm": 0.5, "height_mm": -0.4, "trusted": True}
LIFTED = {**HELD, "left": "lifted", "may_touch": False, "height_mm": 2.0}
KILLED = "the run has no end record"


def run(runs: Path, name: str, at: dict[str, Any] | None, *, ports: str = "here", virtual: bool = False) -> Path:
    """A run's folder; at: where it says that it left the indentor, None where it was killed."""
    folder = runs / name
    folder.mkdir(parents=True)
    (folder / "provenance.json").write_text(
        json.dumps({"virtual": virtual, "subject": "É"}, ensure_ascii=False), "utf-8"
    )
    (folder / "config.toml").write_text(f"[stage]\nport = '{ports}'\n", encoding="utf-8")
    begun = {"doc": "start", "uid": "a", "seq": 0, "t_s": 0.0, "unix_s": 0.0}
    ended = {"doc": "stop", "uid": "b", "seq": 1, "t_s": 1.0, "unix_s": 1.0, "status": "aborted", "reason": name}
    lines = [begun] if at is None else [begun, {**ended, **({"indentor": at} if at else {})}]
    (folder / "events.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines), encoding="utf-8")
    return folder


def _reason(runs: Path) -> str | None:
    left = last_ending(runs, HERE)
    return None if left is None else left.reason


def test_without_runs_there_is_no_last_ending(tmp_path: Path) -> None:
    assert last_ending(tmp_path / "none", HERE) is None
    assert last_ending(tmp_path, HERE) is None


@pytest.mark.parametrize(("at", "told"), [(HELD, "2"), (LIFTED, None), ({}, None), (None, KILLED)])
def test_the_last_run_decides_where_the_indentor_was_left(
    tmp_path: Path, at: dict[str, Any] | None, told: str | None
) -> None:
    """An end that does not say where is one of before it was said: lifted."""
    run(tmp_path, "1", HELD)
    run(tmp_path, "2", at)
    reason = _reason(tmp_path)
    assert (reason is None) if told is None else str(reason).startswith(told)


def test_the_last_ending_reports_the_recorded_position_and_resume_command(tmp_path: Path) -> None:
    folder = run(tmp_path, "1", HELD)
    left = last_ending(tmp_path, HERE)
    assert left is not None
    assert (left.at.left, left.at.may_touch, left.at.x_mm, left.at.height_mm) == ("held", True, 0.5, -0.4)
    assert left.resume == f"rig resume {folder}"


@pytest.mark.parametrize("other", ["virtual", "another stage", "no run", "torn"])
def test_the_last_ending_ignores_virtual_unreadable_and_other_stages_runs(tmp_path: Path, other: str) -> None:
    run(tmp_path, "1", HELD)
    later = run(
        tmp_path, "2", LIFTED, virtual=other == "virtual", ports="there" if other == "another stage" else "here"
    )
    if other == "no run":
        (later / "provenance.json").unlink()
    if other == "torn":
        (later / "events.jsonl").write_text("", encoding="utf-8")
    assert str(_reason(tmp_path)).startswith("1")


def test_the_last_ending_ignores_a_run_owned_by_another_process(tmp_path: Path) -> None:

    run(tmp_path, "1", HELD)
    later = run(tmp_path, "2", None)
    assert KILLED in str(_reason(tmp_path))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(RunFolder, "owned", lambda self: (_ for _ in ()).throw(FolderBusyError(f"{later}: busy")))
        assert last_ending(tmp_path, HERE) is None
