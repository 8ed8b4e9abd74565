"""Models on disk: damaged files are made anew, never trusted."""

import ast
import errno
import io
import json
import logging
import os
import pickle
import shutil
import tracemalloc
import zipfile
from collections.abc import Callable, Iterator
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from sim.config import FingertipConfig
from sim.finger.surface import published_points
from sim.models import cache as model_cache
from sim.models.cache import Arrays, CacheError, cache_dir, cached_arrays, content_key, model_code
from tests.error_codes import raises

ROOT = Path(str(files("sim")))


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache of its own for each test."""
    monkeypatch.setenv("RIG_CACHE_DIR", str(tmp_path / "models"))
    return tmp_path / "models"


class Maker:
    """Makes the same arrays each time and counts."""

    def __init__(self, n: int = 5) -> None:
        self.made = 0
        self.arrays: Arrays = {"a": np.arange(float(n)), "b": np.arange(6).reshape(2, 3)}

    def __call__(self) -> Arrays:
        self.made += 1
        return {name: value.copy() for name, value in self.arrays.items()}

    def get(self, key: str = "k") -> tuple[Arrays, bool]:
        found, from_disk = cached_arrays(key, self)
        assert set(found) == set(self.arrays)
        for name, value in self.arrays.items():
            np.testing.assert_array_equal(found[name], value, strict=True)
        return found, from_disk


def test_a_model_is_made_once_and_then_read_from_the_cache(folder: Path) -> None:
    make = Maker()
    assert make.get()[1] is False
    assert make.get()[1] is True
    assert make.made == 1
    assert cache_dir() == folder
    assert sorted(p.name for p in folder.iterdir() if p.suffix != ".lock") == ["k.model"]


@pytest.mark.parametrize("damage", ["half", "other key"])
def test_a_damaged_cache_file_is_rebuilt(folder: Path, damage: str) -> None:
    make = Maker(5000)
    make.get()
    path = folder / "k.model"
    good = path.read_bytes()
    if damage == "other key":
        make.get("other")
        shutil.copy(folder / "other.model", path)
        make.made -= 1
    else:
        path.write_bytes(good[: len(good) // 2])
    assert make.get()[1] is False
    assert make.made == 2
    assert make.get()[1] is True


def test_any_single_flipped_bit_of_a_cache_file_is_detected(folder: Path) -> None:
    # One bit of every seventh byte of a small file in turn, headers, directory and seal included.
    make = Maker()
    make.get()
    path = folder / "k.model"
    good = path.read_bytes()
    for position in range(0, len(good), 7):
        path.write_bytes(good[:position] + bytes([good[position] ^ (1 << position % 8)]) + good[position + 1 :])
        assert make.get()[1] is False, f"byte {position}"


def test_unusable_cache_folder_is_refused_by_name(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    taken = folder / "a_file"
    folder.mkdir(exist_ok=True)
    taken.touch()
    monkeypatch.setenv("RIG_CACHE_DIR", str(taken))
    with raises(CacheError, "bad_folder", folder=str(taken), problem=os.strerror(errno.EEXIST)):
        cached_arrays("k", lambda: pytest.fail("made in vain"))


def warnings_in(caplog: pytest.LogCaptureFixture) -> list[logging.LogRecord]:
    return [record for record in caplog.records if record.levelno >= logging.WARNING]


def test_a_cache_on_a_full_disk_still_answers_and_warns(
    folder: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def full(path: Path, *_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "replace", full)
    assert Maker().get()[1] is False
    (told,) = warnings_in(caplog)
    assert told.args == (folder, os.strerror(errno.ENOSPC))
    monkeypatch.undo()
    monkeypatch.setenv("RIG_CACHE_DIR", str(folder))
    assert [p.name for p in folder.iterdir() if p.suffix != ".lock"] == []
    assert Maker().get()[1] is False


def test_a_model_that_cannot_be_made_leaves_no_cache_file(folder: Path) -> None:
    def fail() -> Arrays:
        raise RuntimeError("no model today")

    with pytest.raises(RuntimeError, match="no model today"):
        cached_arrays("k", fail)
    assert [p.name for p in folder.iterdir() if p.suffix != ".lock"] == []
    assert Maker().get()[1] is False


def sealed(folder: Path, content: bytes) -> None:
    folder.mkdir(exist_ok=True)
    (folder / "k.model").write_bytes(model_cache._seal("k", memoryview(content)) + content)


def zipped(parts: dict[str, bytes], method: int = zipfile.ZIP_STORED) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", method) as archive:
        for name, part in parts.items():
            archive.writestr(name, part)
    return stream.getvalue()


def npy(array: NDArray[Any]) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


def pickled(array: NDArray[Any]) -> bytes:
    """Objects as long as their header says, and in them an array that the layout wants."""
    content = pickle.dumps(array)
    header = npy(np.zeros(-(-len(content) // 8))).replace(b"'<f8'", b"'|O' ")[:128]
    return header + content + bytes(-len(content) % 8)


def npy_header(shape: str, padding: int = 0) -> bytes:
    header = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}{' ' * padding}\n".encode()
    if len(header) < 1 << 16:
        return b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header
    return b"\x93NUMPY\x02\x00" + len(header).to_bytes(4, "little") + header


def a_pipe(folder: Path) -> None:
    folder.mkdir()
    os.mkfifo(folder / "k.model")


def a_sparse_file(folder: Path) -> None:
    folder.mkdir()
    (folder / "k.model").touch()
    os.truncate(folder / "k.model", 1 << 40)


def two(a: NDArray[Any], b: NDArray[Any]) -> bytes:
    return zipped({"a.npy": npy(a), "b.npy": npy(b)})


B = npy(np.ones((2, 3)))
HOSTILE: dict[str, Callable[[Path], None]] = {
    "no archive": lambda folder: sealed(folder, b"PK"),
    "nothing in it": lambda folder: sealed(folder, zipped({})),
    "a pickle": lambda folder: sealed(folder, pickle.dumps([1])),
    "objects": lambda folder: sealed(folder, zipped({"a.npy": npy(np.array([{}]))})),
    "a pickle that fills an array": lambda folder: sealed(folder, zipped({"a.npy": pickled(np.ones(5)), "b.npy": B})),
    "compressed": lambda folder: sealed(folder, zipped({"a.npy": npy(np.zeros(10**7))}, zipfile.ZIP_DEFLATED)),
    "a terabyte": lambda folder: sealed(folder, zipped({"a.npy": npy_header("(1000000000000,)")})),
    "no length": lambda folder: sealed(folder, zipped({"a.npy": npy_header("(-1,)")})),
    "a huge header": lambda folder: sealed(folder, zipped({"a.npy": npy_header("(1,)", 10**6)})),
    "no header": lambda folder: sealed(folder, zipped({"a.npy": npy_header("__import__('os').getpid()")})),
    "nested": lambda folder: sealed(folder, zipped({"a.npy": npy_header("(" * 5000)})),
    "integers": lambda folder: sealed(folder, two(np.arange(5), np.ones((2, 3)))),
    "another axis": lambda folder: sealed(folder, two(np.ones((5, 1)), np.ones((2, 3)))),
    "another length": lambda folder: sealed(folder, two(np.ones(5), np.ones((2, 4)))),
    "one missing": lambda folder: sealed(folder, zipped({"a.npy": npy(np.ones(5))})),
    "a folder": lambda folder: (folder / "k.model").mkdir(parents=True),
    "a pipe": a_pipe,
    "a sparse file": a_sparse_file,
}


@pytest.mark.skipif(os.name != "posix", reason="Windows has no pipes in folders")
@pytest.mark.parametrize("what", HOSTILE)
def test_a_hostile_cache_file_is_rebuilt_with_one_warning(
    folder: Path, what: str, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(model_cache, "_reported", set())
    HOSTILE[what](folder)
    expected = {"a": np.arange(5.0), "b": np.zeros((2, 3))}
    tracemalloc.start()
    found, read = cached_arrays("k", lambda: expected, layout={"a": ("f", "n"), "b": ("f", "23")})
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert found is expected
    assert not read
    assert peak < 5e7
    reasons = [record.args for record in warnings_in(caplog)]
    assert len(reasons) == (2 if what == "a folder" else 1)  # a folder stays in the way
    if what != "a folder":
        assert cached_arrays("k", lambda: {}, layout={"a": ("f", "n"), "b": ("f", "23")})[1]


def leaves(tree: dict[str, Any], path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    for name, value in tree.items():
        if isinstance(value, dict):
            yield from leaves(value, (*path, name))
        else:
            yield (*path, name), value


POINTS = published_points()[1].tolist()
SECTIONS = [[z, 4.0, 4.0, 0.0] for z in (0.0, 3.0, 6.0, 9.0, 12.75)]


def another(name: str, value: Any) -> Any:
    """A slightly different value that the settings still allow."""
    if isinstance(value, list):
        return {"points": POINTS, "sections": SECTIONS}[name]
    if isinstance(value, str):
        return {"bbar": "full", "rigid": "elastic", "default": "fine"}[value]
    if value is None:
        return 0.3
    if isinstance(value, bool):
        return not value
    return value + 1 if isinstance(value, int) else value * 1.0001


def test_a_full_cache_removes_the_least_recently_read_models(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def stored() -> set[str]:
        return {path.stem for path in folder.glob("*.model")}

    cached_arrays("first", lambda: {"a": np.zeros(1000)})
    size = (folder / "first.model").stat().st_size
    monkeypatch.setattr("sim.models.cache.MOST_BYTES", 3.5 * size)
    for age_s, key in enumerate(("second", "third")):
        cached_arrays(key, lambda: {"a": np.zeros(1000)})
        os.utime(folder / f"{key}.model", (age_s, age_s))
    assert cached_arrays("first", lambda: {})[1]  # read, so it is not the oldest
    cached_arrays("fourth", lambda: {"a": np.zeros(1000)})
    assert stored() == {"first", "third", "fourth"}
    monkeypatch.setattr("sim.models.cache.MOST_BYTES", 0.0)
    cached_arrays("fifth", lambda: {"a": np.zeros(1000)})
    assert stored() == {"fifth"}


def test_the_environment_variable_limits_the_cache_size(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And one that is none is told before anything is made."""
    cached_arrays("first", lambda: {"a": np.zeros(1000)})
    os.utime(folder / "first.model", (1, 1))
    size = (folder / "first.model").stat().st_size
    monkeypatch.setenv("RIG_CACHE_GB", str(2 * size / 1e9))
    cached_arrays("second", lambda: {"a": np.zeros(1000)})
    assert len(list(folder.glob("*.model"))) == 2
    monkeypatch.setenv("RIG_CACHE_GB", str((2 * size - 1) / 1e9))
    os.utime(folder / "second.model", (2, 2))
    cached_arrays("third", lambda: {"a": np.zeros(1000)})
    assert {path.name for path in folder.iterdir()} == {"third.model", "third.lock"}
    monkeypatch.setenv("RIG_CACHE_GB", "five")
    with raises(CacheError, "bad_size", value="five"):
        cached_arrays("fourth", lambda: pytest.fail("made in vain"))


def imported(source: Path) -> set[Path]:
    """The modules of sim, and of what it shares, that a module imports."""
    found = set()
    for node in ast.walk(ast.parse(source.read_text())):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(("sim", "rig_shared")):
            place = ROOT.parent.joinpath(*(node.module or "").split("."))
            candidates = [place.with_suffix(".py"), *(place / f"{alias.name}.py" for alias in node.names)]
            found |= {candidate for candidate in candidates if candidate.exists()}
    return found


def test_the_cache_key_covers_all_code_that_makes_a_model() -> None:
    maker = ROOT / "models" / "finger_3d.py"
    reached, new = {maker}, {maker}
    while new:
        new = set().union(*map(imported, new)) - reached
        reached |= new
    covered = set(model_code(ROOT))
    assert len(reached) > 10
    assert reached <= covered
    assert not {path for path in covered - reached if path.parent.name in ("models", "contact")}


def test_the_cache_key_changes_with_every_parameter() -> None:
    # How it is touched, and what its answers are multiplied by, changes no model (test_stiffness_scale.py).
    no_matter = {"contact": True, "tissue": {"stiffness", "strain", "stiffening"}}
    default = FingertipConfig().model_dump(mode="json", exclude=no_matter)
    keys = {content_key(default)}
    names = list(leaves(default))
    assert len(names) > 25
    for path, value in names:
        changed = json.loads(json.dumps(default))
        inner = changed
        for name in path[:-1]:
            inner = inner[name]
        inner[path[-1]] = another(path[-1], value)
        FingertipConfig.model_validate(changed)
        keys.add(content_key(changed))
    assert len(keys) == len(names) + 1
