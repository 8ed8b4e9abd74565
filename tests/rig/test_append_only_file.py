"""A file of whole lines that notices how it was lost; and errors of files and ports survive a pickle."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from rig.data.journal import LineFile, LostFileError
from tests.error_codes import raises


def _replaced(path: Path) -> None:
    path.unlink()
    path.write_bytes(b"one\n")


LOST: dict[str, tuple[str, Callable[[Path], object]]] = {
    "deleted": ("deleted", Path.unlink),
    "moved": ("moved", lambda path: path.rename(path.with_suffix(".old"))),
    "folder moved": ("moved", lambda path: path.parent.rename(path.parent.with_name("elsewhere"))),
    "folder deleted": ("deleted", lambda path: shutil.rmtree(path.parent)),
    "folder no more one": ("not_found", lambda path: (shutil.rmtree(path.parent), path.parent.touch())),
    "replaced": ("replaced", _replaced),
    "shortened": ("shortened", lambda path: path.write_bytes(b"on")),
}


@pytest.mark.parametrize("how", LOST)
def test_a_lost_file_reports_how_it_was_lost_at_every_check(how: str, tmp_path: Path) -> None:
    code, lose = LOST[how]
    path = tmp_path / "runs" / "events.jsonl"
    path.parent.mkdir()
    file = LineFile(path)
    file.append(b"one\n")
    file.check()
    lose(path)
    for _ in range(2):
        with raises(LostFileError, code) as caught:
            file.check()
        assert (caught.value.filename, caught.value.strerror) == (str(path), str(caught.value))
    assert file.content() == (b"on" if how == "shortened" else b"one\n")
    file.close()
