"""`rig cache`: what is kept, how much of it stays, and what is removed."""

import os
from pathlib import Path

import pytest

from sim.models.cache import CacheError, most_bytes
from tests.program import Program

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


def test_cache_json_lists_every_file_most_recently_read_first(program: Program, folder: Path) -> None:
    said = program("cache", "--json").json
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
    program: Program, folder: Path, words: tuple[str, ...], left: set[str]
) -> None:
    said = program("cache", "--prune", *words, "--json").json
    gone = {name: size for name, (size, _) in FILES.items() if name not in left}
    assert {entry["name"] for entry in said["entries"]} == left
    assert (said["removed"], said["removed_bytes"]) == (len(gone), sum(gone.values()))
    locks = {Path(name).with_suffix(".lock").name for name in left}
    assert {path.name for path in folder.iterdir()} == left | locks | {"mine.txt"}


@pytest.mark.parametrize("given", ["much", "-1", "nan", "inf", ""])
def test_a_cache_limit_that_is_not_a_positive_number_is_refused(
    program: Program, monkeypatch: pytest.MonkeyPatch, given: str
) -> None:
    monkeypatch.setenv("RIG_CACHE_GB", given)
    with pytest.raises(CacheError):
        most_bytes()
    assert program("cache").code == 2
