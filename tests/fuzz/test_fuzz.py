"""Every file that the program reads, and every reply of a device: a success, or its own error with a code.

In the suite 250 inputs for each quick reader, fewer for slow ones, and all that once failed. `make test-studies`
reads a thousand, `make shake` a million (tests/fuzz/campaign.py). The program reads in this process here; limits of
time and memory are the campaign's.
"""

import math
from collections.abc import Callable
from pathlib import Path
from typing import NoReturn

import pytest

from rig.devices.base import ForceError, ForceReading, StageError
from rig.devices.registry import BUILT_IN
from tests.contracts.force import Connected, ForceBytes
from tests.fuzz import devices
from tests.fuzz.campaign import shares
from tests.fuzz.harness import EVERY, Target
from tests.fuzz.once_failed import ONCE_FAILED
from tests.fuzz.readers import NOT_READ, failure_of


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder that is the current one, and stays empty but for what a test names."""
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    return folder


@pytest.mark.quick(rows=lambda name, part: part == "a quarter")
@pytest.mark.parametrize("part", ["a quarter", "the rest"])
@pytest.mark.parametrize("name", EVERY)
def test_a_reader_ends_well(name: str, part: str, here: Path) -> None:
    target, count = Target(name, here / "files"), EVERY[name].in_suite
    for example in target.examples:
        assert target.failure(example) == ""
        assert name in NOT_READ or target.succeeded
    failed = {}
    quarter = math.ceil(count / 4)
    for seed in range(quarter) if part == "a quarter" else range(quarter, count):
        if what := target.failure(target.mutated(seed)):
            failed[seed] = what
    assert failed == {}
    assert [path.name for path in here.iterdir()] == ["files"]


@pytest.mark.parametrize("name", ONCE_FAILED)
def test_what_once_failed(name: str, here: Path) -> None:
    target = Target(name, here / "files")
    for what, content in ONCE_FAILED[name].items():
        assert target.failure(target.mutated(content) if isinstance(content, int) else content) == "", what


def test_the_harness_sees_what_is_wrong(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "a"

    def raising(error: BaseException) -> str:
        def read(_: Path) -> None:
            raise error

        return failure_of(read, path)

    assert raising(KeyError("a")).startswith("KeyError")
    assert raising(MemoryError("a")).startswith("MemoryError")
    assert raising(OSError("of a library")).startswith("OSError")
    assert raising(SystemExit(2)).startswith("ended with 2")  # without a line
    assert raising(FileNotFoundError(2, "No such file", "a")) == ""


def test_a_million_inputs_leave_none_out() -> None:
    each = shares(1_000_000, list(EVERY))
    assert sum(each.values()) == pytest.approx(1_000_000, rel=1e-3)
    assert min(each.values()) >= 100


# --- devices ---


def test_every_kind_of_device_is_in_the_table() -> None:
    assert {name for names in BUILT_IN.values() for name in names} == devices.KINDS
    for kind in devices.KINDS:
        of_a_kind = [table.name for table in devices.tables() if table.kind == kind]
        assert sum(EVERY[name].in_suite for name in of_a_kind) >= devices.IN_SUITE


def raise_(error: Exception) -> NoReturn:
    raise error


class Wrong:
    """A driver with a mistake, in the place of a sensor that has connected."""

    def __init__(self, act: Callable[[], ForceReading]) -> None:
        self.read = act
        self.identify = self.connect = lambda: ""


@pytest.mark.parametrize(
    ("mistake", "found"),
    [
        (lambda bench: float("x"), "ValueError"),
        (lambda bench: ForceReading(math.nan, True, 0.0), "AssertionError"),
        (lambda bench: raise_(StageError("of another device")), "AssertionError"),
        (lambda bench: bench.clock.wait_s(60.0), "AssertionError"),
        (lambda bench: bench.wire.asked.append(bench.device.zero), "AssertionError"),
        (lambda bench: [bench.wire.read(0.0) for _ in range(devices.MOST_READS + 1)], "AssertionError"),
        (lambda bench: raise_(ForceError("its own")), ""),
    ],
)
def test_a_parser_with_a_mistake_is_seen(
    mistake: Callable[[Connected], object], found: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    table = next(table for table in devices.tables() if isinstance(table, ForceBytes))
    parser = devices.ForceParser(table)
    made = parser._new

    def with_a_mistake() -> Connected:
        bench = made()
        bench.driver = Wrong(lambda: mistake(bench))
        return bench

    monkeypatch.setattr(parser, "_new", with_a_mistake)
    (tmp_path / "reply").write_bytes(b"\0\0")
    assert failure_of(parser.read, tmp_path / "reply").partition(":")[0] == found
