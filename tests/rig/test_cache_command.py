"""`rig cache`: what is kept, how much of it stays, and what is removed."""

import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rig.cli import main
from sim.models.cache import CacheError, most_bytes

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


def test_cache_json_lists_every_file_most_recently_read_first(rig: Said, folder: Path) -> None:
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
def test_pruning_the_cache_keeps_the_most_recently_read_models_within_the_limit(
    rig: Said, folder: Path, words: tuple[str, ...], left: set[str]
) -> None:
    said = as_json(rig("--prune", *words, "--json"))
    gone = {name: size for name, (size, _) in FILES.items() if name not in left}
    assert {entry["name"] for entry in said["entries"]} == left
    assert (said["removed"], said["removed_bytes"]) == (len(gone), sum(gone.values()))
    locks = {Path(name).with_suffix(".lock").name for name in left}
    assert {path.name for path in folder.iterdir()} == left | locks | {"mine.txt"}


@pytest.mark.parametrize("given", ["much", "-1", "nan", "inf", ""])
def test_a_cache_limit_that_is_not_a_positive_number_is_refused(
    rig: Said, monkeypatch: pytest.MonkeyPatch, given: str
) -> None:
    monkeypatch.setenv("RIG_CACHE_GB", given)
    with pytest.raises(CacheError):
        most_bytes()
    assert rig()[0] == 2
