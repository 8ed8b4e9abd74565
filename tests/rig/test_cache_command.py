"""`rig cache`: what is kept, how much of it stays, and what is removed."""

import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rig.cli import main
from rig.cli.installation import _ABOUT
from sim.models.cache import KINDS, CacheError, entries, most_bytes

Said = Callable[..., tuple[int, str, str]]

FILES = {"new.model": (2_000_000, 300), "old.answers": (1_000_000, 100), "middle.model": (500_000, 200)}
"""Bytes, and when they were read last."""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Three files and what lies beside them."""
    for name, (size, read_s) in FILES.items():
        (tmp_path / name).write_bytes(bytes(size))
        os.utime(tmp_path / name, (read_s, read_s))
        (tmp_path / name).with_suffix(".lock").touch()
    (tmp_path / "mine.txt").touch()
    monkeypatch.setenv("RIG_CACHE_DIR", str(tmp_path))
    return tmp_path


@pytest.fixture
def rig(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Said:
    """Run it here: exit code, standard output, standard error."""

    def run(*words: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["rig", "cache", *words])
        with pytest.raises(SystemExit) as ended:
            main()
        printed = capsys.readouterr()
        return int(ended.value.code or 0), printed.out, printed.err

    return run


def as_json(said: tuple[int, str, str]) -> dict[str, Any]:
    assert (said[0], said[2]) == (0, "")
    return dict(json.loads(said[1]))


def test_what_is_kept_is_said_kind_by_kind(rig: Said, folder: Path) -> None:
    code, told, err = rig()
    assert (code, err) == (0, "")
    where, model, answers, together = told.splitlines()
    assert where == f"folder      {folder} (RIG_CACHE_DIR)"
    assert model.startswith("model       2 files, 2.5 MB: ")
    assert answers.startswith("answers     1 file, 1.0 MB: ")
    assert [line.count("1970-01-01") for line in (model, answers)] == [2, 2]
    assert together.startswith("total       3.5 MB; above 5 GB (RIG_CACHE_GB) ")
    assert len(list(folder.iterdir())) == 7


def test_as_json_every_file_is_there_what_was_read_last_first(rig: Said, folder: Path) -> None:
    said = as_json(rig("--json"))
    assert said.pop("entries") == [
        {"name": "new.model", "kind": "model", "bytes": 2_000_000, "read_utc": "1970-01-01T00:05:00+00:00"},
        {"name": "middle.model", "kind": "model", "bytes": 500_000, "read_utc": "1970-01-01T00:03:20+00:00"},
        {"name": "old.answers", "kind": "answers", "bytes": 1_000_000, "read_utc": "1970-01-01T00:01:40+00:00"},
    ]
    assert said == {"folder": str(folder), "bytes": 3_500_000, "limit_gb": 5.0, "removed": 0, "removed_bytes": 0}


@pytest.mark.parametrize(
    ("words", "left"),
    [
        ((), set()),
        (("--keep-gb", "0.0025"), {"new.model", "middle.model"}),
        (("--keep-gb", "0.0024"), {"new.model"}),
        (("--keep-gb", "1"), set(FILES)),
    ],
)
def test_pruning_leaves_what_was_read_last(rig: Said, folder: Path, words: tuple[str, ...], left: set[str]) -> None:
    said = as_json(rig("--prune", *words, "--json"))
    gone = {name: size for name, (size, _) in FILES.items() if name not in left}
    assert {entry["name"] for entry in said["entries"]} == left
    assert (said["removed"], said["removed_bytes"]) == (len(gone), sum(gone.values()))
    locks = {Path(name).with_suffix(".lock").name for name in left}
    assert {path.name for path in folder.iterdir()} == left | locks | {"mine.txt"}


def test_what_was_removed_is_said(rig: Said, folder: Path) -> None:
    assert rig("--prune")[1].endswith("removed     3 files, 3.5 MB\n")


def test_a_folder_that_is_not_there_holds_nothing(rig: Said, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RIG_CACHE_DIR", str(folder / "none"))
    assert as_json(rig("--prune", "--json"))["entries"] == []


@pytest.mark.parametrize("given", ["much", "-1", "nan", "inf", ""])
def test_a_limit_that_is_none_is_refused(rig: Said, monkeypatch: pytest.MonkeyPatch, given: str) -> None:
    monkeypatch.setenv("RIG_CACHE_GB", given)
    with pytest.raises(CacheError):
        most_bytes()
    assert rig()[0] == 2


@pytest.mark.parametrize(("given", "expected"), [("0", 0.0), ("0.5", 5e8), ("20", 2e10)])
def test_the_limit_is_in_gigabytes(monkeypatch: pytest.MonkeyPatch, given: str, expected: float) -> None:
    monkeypatch.setenv("RIG_CACHE_GB", given)
    assert most_bytes() == expected


def test_what_is_kept_goes_with_pruning_only(rig: Said, folder: Path) -> None:
    code, told, _ = rig("--keep-gb", "1", "--json")
    assert (code, json.loads(told)["code"]) == (2, "needs_option")
    assert len(entries()) == 3


def test_every_kind_is_explained() -> None:
    assert set(_ABOUT) == set(KINDS)
