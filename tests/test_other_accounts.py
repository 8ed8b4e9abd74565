"""Code that another account could have written never runs."""

import logging
import os
import pickle
import py_compile
from collections.abc import Callable, Iterator
from contextlib import suppress
from importlib.util import cache_from_source
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from rig.compare import wider_run
from rig.engine.bench_memory import BenchMemory
from rig.protocol.script import load_script
from sim import compiling

pytestmark = pytest.mark.skipif(os.name != "posix", reason="Windows has no modes")

OTHER = 65_534


class Bomb:
    """Makes a folder when it is unpickled."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self) -> tuple[object, ...]:
        return os.mkdir, (str(self.mark),)


def doubled(x: float) -> float:
    return 2 * x


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The user's cache folder, as of a new account."""
    monkeypatch.setattr(compiling, "user_cache_path", lambda name: tmp_path / name)
    compiling._folder.cache_clear()
    yield tmp_path / "indentation-rig"
    compiling._folder.cache_clear()


def _to_another_account(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if os.geteuid() == 0:
        os.chown(folder, OTHER, OTHER)
    else:
        monkeypatch.setattr(os, "geteuid", lambda: os.getuid() + 1)


def _linked(folder: Path) -> None:
    folder.rename(folder.with_name("theirs"))
    folder.symlink_to(folder.with_name("theirs"))


SITUATIONS: dict[str, Callable[[Path, pytest.MonkeyPatch], object]] = {
    "of another account": _to_another_account,
    "writable by everyone": lambda folder, _: folder.chmod(0o777),
    "a link": lambda folder, _: _linked(folder),
}


def _planted(cache: Path, suffix: str) -> tuple[Path, Path]:
    """Return the folder of machine code, in which a bomb lies, and the folder that the bomb makes."""
    assert compiling.compiled(doubled)(3.0) == 6.0
    (folder,) = cache.glob("loops-*")
    mark = cache.parent / "mark"
    found = list(folder.rglob(f"*.{suffix}"))
    assert found
    for file in found:
        file.write_bytes(pickle.dumps(Bomb(mark)))
    compiling._folder.cache_clear()
    return folder, mark


@pytest.mark.parametrize("suffix", ["nbi", "nbc"])
@pytest.mark.parametrize("situation", SITUATIONS)
def test_machine_code_of_a_folder_that_others_can_change_never_runs(
    cache: Path, situation: str, suffix: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    folder, mark = _planted(cache, suffix)
    SITUATIONS[situation](folder, monkeypatch)
    with caplog.at_level(logging.WARNING, "sim"):
        assert compiling.compiled(doubled)(3.0) == 6.0
    assert not mark.exists()
    (said,) = caplog.records
    assert "can be changed by other accounts" in said.getMessage()


@pytest.mark.parametrize("suffix", ["nbi", "nbc"])
def test_machine_code_of_the_users_own_folder_runs(cache: Path, suffix: str) -> None:
    """The bombs of the test above do explode."""
    _, mark = _planted(cache, suffix)
    with suppress(FileExistsError):  # numba reads an index twice
        compiling.compiled(doubled)(3.0)
    assert mark.exists()


def test_byte_code_beside_a_script_never_runs(tmp_path: Path) -> None:
    script, other, mark = tmp_path / "mine.py", tmp_path / "other.py", tmp_path / "mark"
    script.write_text("def run(rig): ...\n")
    other.write_text(f"import os\nos.mkdir({str(mark)!r})\ndef run(rig): ...\n")
    to = Path(cache_from_source(str(script)))
    py_compile.compile(str(other), str(to), invalidation_mode=py_compile.PycInvalidationMode.UNCHECKED_HASH)
    load_script(str(script))
    assert not mark.exists()


@pytest.mark.parametrize("ours", [True, False])
def test_the_script_of_a_compared_run_runs_only_if_it_is_ours(
    tmp_path: Path, ours: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, mark = tmp_path / "run", tmp_path / "mark"
    folder.mkdir()
    (folder / "protocol.py").write_text(f"import os\nos.mkdir({str(mark)!r})\ndef run(rig): ...\n")
    start = {"parameters": {"from_mm": 0.0, "to_mm": 1.0}, "protocol": "mine"}
    run: Any = SimpleNamespace(folder=SimpleNamespace(path=folder), start=start)
    if not ours:
        for path in (folder / "protocol.py", folder):
            _to_another_account(path, monkeypatch)
    wider_run._script(run)
    assert mark.exists() is ours


def test_the_record_of_a_bench_is_not_written_through_a_link(tmp_path: Path) -> None:
    memory = BenchMemory.__new__(BenchMemory)
    memory._path = tmp_path / "bench.json"
    (tmp_path / "mine").write_text("mine")
    (tmp_path / f"bench.{os.getpid()}").symlink_to(tmp_path / "mine")
    memory.moves()
    assert (tmp_path / "mine").read_text() == "mine"
