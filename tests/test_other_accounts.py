"""Files that another account could have written: their code never runs, and their numbers count only by choice."""

import logging
import os
import pickle
import py_compile
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from importlib.util import cache_from_source, module_from_spec, spec_from_file_location
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rig.compare import wider_run
from rig.engine.bench_memory import BenchMemory
from rig.protocol.script import load_script
from sim import compiling, trust
from sim.models import cache
from sim.models.cache import cached_arrays

pytestmark = pytest.mark.skipif(os.name != "posix", reason="Windows has no modes")

ROOT = os.name == "posix" and os.geteuid() == 0
OTHER = 65_534
"""Another account. Without the rights of root, the files stay ours, and the program takes itself for another one."""

MODULES = [name if name.endswith(".py") else f"{name}/loops.py" for name in compiling._WITH_LOOPS]


class Bomb:
    """Makes a folder when it is unpickled."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self) -> tuple[object, ...]:
        return os.mkdir, (str(self.mark),)


def doubled(x: float) -> float:
    return 2 * x


def give(path: Path) -> None:
    """Give a file, or a folder with all in it, to another account."""
    if ROOT:
        for one in [path, *path.rglob("*")]:
            os.chown(one, OTHER, OTHER, follow_symlinks=False)


# --- situations: each makes a folder changeable by others, and gives what lies in it to another account ---


def belongs_to_another(folder: Path) -> None:
    give(folder)


def parent_belongs_to_another(folder: Path) -> None:
    give(folder.parent)


def group_writable(folder: Path) -> None:
    give(folder)
    if ROOT:
        os.chown(folder, 0, OTHER)
    folder.chmod(0o775)


def world_writable(folder: Path) -> None:
    give(folder)
    if ROOT:
        os.chown(folder, 0, 0)
    folder.chmod(0o777)


def sticky(folder: Path) -> None:
    world_writable(folder)
    folder.chmod(0o1777)


def parent_world_writable(folder: Path) -> None:
    """The folder itself is ours, and so is the file that was exchanged in it."""
    folder.parent.chmod(0o777)


def link_to_anothers(folder: Path) -> None:
    there = folder.with_name("theirs")
    folder.rename(there)
    folder.symlink_to(there)
    give(there)


def formerly_writable(folder: Path) -> None:
    """The folder is ours again, but not all that lies in it."""
    for file in [path for path in folder.rglob("*") if path.is_file()]:
        give(file)


def linked_files(folder: Path) -> None:
    store = folder.with_name("store")
    store.mkdir()
    for n, file in enumerate([path for path in folder.rglob("*") if path.is_file() and path.name != "mine.py"]):
        shutil.move(file, store / str(n))
        file.symlink_to(store / str(n))
    give(store)


def writable_files(folder: Path) -> None:
    for file in [path for path in folder.rglob("*") if path.is_file()]:
        file.chmod(0o666)


SITUATIONS: list[Callable[[Path], None]] = [
    belongs_to_another,
    parent_belongs_to_another,
    group_writable,
    world_writable,
    sticky,
    parent_world_writable,
    link_to_anothers,
    formerly_writable,
    linked_files,
    writable_files,
]

CHOSEN = {belongs_to_another, parent_belongs_to_another, group_writable, link_to_anothers}
"""Numbers count there: RIG_CACHE_DIR names a folder whose owner or group may write to it, and no one else."""

OURS = {parent_world_writable}
"""Numbers count there: the file is ours, and opened before it is checked."""

CHOSEN_HERE = CHOSEN | (OURS if ROOT else {formerly_writable})
"""Only root can give away a single file; without root the folder is another's with all that lies in it."""


# --- kinds: each plants something in a folder and returns what uses it, which is true if it was used ---


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder for modules and caches; there is no other place for machine code."""
    for name in MODULES:
        (tmp_path / "modules" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "modules" / name).write_text("1")
    (tmp_path / "file").touch()
    monkeypatch.setattr(compiling, "_HERE", tmp_path / "modules")
    monkeypatch.setattr(compiling, "user_cache_path", lambda name: tmp_path / "file" / name)
    monkeypatch.setenv("RIG_CACHE_DIR", str(tmp_path / "file" / "cache"))
    monkeypatch.setattr(cache, "_reported", set(), raising=False)
    compiling._folder.cache_clear()
    yield tmp_path
    compiling._folder.cache_clear()


Use = Callable[[], bool]


def machine_code(suffix: str) -> Callable[[Path, Path], Use]:
    def plant(folder: Path, mark: Path) -> Use:
        compiling._folder.cache_clear()
        assert compiling.compiled(doubled)(3.0) == 6.0
        found = list(folder.rglob(f"*.{suffix}"))
        assert found
        for file in found:
            file.write_bytes(pickle.dumps(Bomb(mark)))
        compiling._folder.cache_clear()

        def use() -> bool:
            assert compiling.compiled(doubled)(3.0) == 6.0
            return mark.exists()

        return use

    return plant


def arrays(folder: Path, mark: Path) -> Use:
    cached_arrays("k", lambda: {"a": np.array([1.0])})
    return lambda: cached_arrays("k", lambda: {"a": np.array([2.0])})[1]


def bytecode(folder: Path, mark: Path) -> Use:
    script, other = folder / "mine.py", mark.with_name("other.py")
    folder.mkdir()
    script.write_text("def run(rig): ...\n")
    other.write_text(f"import os\nos.mkdir({str(mark)!r})\ndef run(rig): ...\n")
    to = Path(cache_from_source(str(script)))
    py_compile.compile(str(other), str(to), invalidation_mode=py_compile.PycInvalidationMode.UNCHECKED_HASH)

    def use() -> bool:
        load_script(str(script))
        return mark.exists()

    return use


def compared_run(folder: Path, mark: Path) -> Use:
    folder.mkdir()
    (folder / "protocol.py").write_text(f"import os\nos.mkdir({str(mark)!r})\ndef run(rig): ...\n")
    start = {"parameters": {"from_mm": 0.0, "to_mm": 1.0}, "protocol": "mine"}
    run: Any = SimpleNamespace(folder=SimpleNamespace(path=folder), start=start)

    def use() -> bool:
        wider_run._script(run)
        return mark.exists()

    return use


SILENT = ("bytecode", "compared run")
KINDS: dict[str, tuple[str, Callable[[Path, Path], Use]]] = {
    "index beside the modules": ("modules/__pycache__", machine_code("nbi")),
    "code beside the modules": ("modules/__pycache__", machine_code("nbc")),
    "index in the cache": ("shared/cache", machine_code("nbi")),
    "code in the cache": ("shared/cache", machine_code("nbc")),
    "arrays": ("shared/cache", arrays),
    "bytecode": ("shared/scripts", bytecode),
    "compared run": ("shared/run", compared_run),
}


LIKE_ANOTHER = {"code beside the modules", "index in the cache"}
"""An index and code are trusted by the same folder: each is tried in one of the two in every situation."""


@pytest.mark.parametrize("situation", SITUATIONS, ids=lambda one: one.__name__)
@pytest.mark.parametrize("kind", sorted(KINDS.keys() - LIKE_ANOTHER))
def test_nothing_of_others_is_used(
    here: Path,
    kind: str,
    situation: Callable[[Path], None],
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    where, plant = KINDS[kind]
    folder, mark = here / where, here / "mark"
    folder.parent.mkdir(exist_ok=True)
    if where == "shared/cache":
        monkeypatch.setenv("RIG_CACHE_DIR", str(folder))
        monkeypatch.setattr(os, "access", lambda path, how: False)
    use = plant(folder, mark)
    situation(folder)
    if not ROOT:
        monkeypatch.setattr(os, "geteuid", lambda: os.getuid() + 1)
    caplog.clear()
    with caplog.at_level(logging.WARNING, "sim"):
        used = use()
    counts = kind == "arrays" and situation in CHOSEN_HERE
    assert used == counts
    assert not mark.exists()
    if kind in SILENT or counts:
        assert not caplog.records
    else:
        assert len(caplog.records) in (1, 2)  # refused; in a folder of others the new one is not stored


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_ours_alone_is_used(here: Path, kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The bombs of the test above do explode."""
    where, plant = KINDS[kind]
    folder = here / where
    folder.parent.mkdir(exist_ok=True)
    if where == "shared/cache":
        monkeypatch.setenv("RIG_CACHE_DIR", str(folder))
        monkeypatch.setattr(os, "access", lambda path, how: False)
    use = plant(folder, here / "mark")
    if kind == "bytecode":
        assert not use()
    elif kind in ("arrays", "compared run"):
        assert use()
    else:
        with suppress(FileExistsError):  # numba reads an index twice
            use()
        assert (here / "mark").exists()


# --- temporary files, whose names another account may know before ---


def stored_arrays(folder: Path) -> None:
    cached_arrays("k", lambda: {"a": np.zeros(3)})


def recorded_zero(folder: Path) -> None:
    memory = BenchMemory.__new__(BenchMemory)
    memory._path = folder / "bench.json"
    memory.moves()


TEMPORARY = {
    f"k.{os.getpid()}.part": stored_arrays,
    f"bench.{os.getpid()}": recorded_zero,
}


@pytest.mark.parametrize("name", TEMPORARY, ids=["arrays", "bench"])
def test_nothing_is_written_through_a_link(tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RIG_CACHE_DIR", str(tmp_path / "cache"))
    (tmp_path / "cache").mkdir()
    (tmp_path / "mine").write_text("mine")
    (tmp_path / "cache" / name).symlink_to(tmp_path / "mine")
    TEMPORARY[name](tmp_path / "cache")
    assert (tmp_path / "mine").read_text() == "mine"
    assert len([path for path in (tmp_path / "cache").iterdir() if path.suffix != ".lock"]) == 1


# --- what has no modes ---


def test_on_windows_machine_code_is_read_inside_the_profile_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    spec = spec_from_file_location("trust_on_windows", trust.__file__)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    with monkeypatch.context() as patch:
        patch.setattr(sys, "platform", "win32")
        spec.loader.exec_module(module)
    monkeypatch.setattr(Path, "home", lambda: tmp_path / "profile")
    inside, outside = tmp_path / "profile" / "loops", tmp_path / "elsewhere" / "loops"
    assert module.own_folder(inside) == inside
    link = tmp_path / "profile" / "link"
    link.symlink_to(outside.parent)
    for folder in (outside, link / "loops"):
        with pytest.raises(module.ChangeableError):
            module.own_folder(folder)
    (tmp_path / "file").write_bytes(b"numbers")
    with module.open_trusted(tmp_path / "file", module.trusted_in(outside)) as stream:
        assert stream.read() == b"numbers"
