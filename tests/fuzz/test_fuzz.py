"""Every file that the program reads, and every reply of a device: a success, or its own error with a code.

HOSTILE=200 reads two hundred times as many files and hears as many more replies, from a new seed (make shake); then
each file may take 5 s of processor time and 1 GB.
"""

import math
import os
import resource
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NoReturn

import pytest
from hypothesis import HealthCheck, given, settings

from rig.devices.base import ForceError, ForceReading, StageError
from rig.devices.registry import BUILT_IN
from tests.contracts.force import Connected, ForceBytes
from tests.fuzz import devices
from tests.fuzz.harness import Target
from tests.fuzz.hostile import hostile
from tests.fuzz.once_failed import ONCE_FAILED, REPLIES_ONCE_FAILED
from tests.fuzz.readers import NOT_READ, READERS, failure_of

TIMES = int(os.environ.get("HOSTILE", "0"))
MOST_S, MOST_BYTES = 5.0, 1 << 30
CONVERSATIONS = 30


def examples(number: int) -> settings:
    """Return settings for so many examples, always the same ones unless HOSTILE says how many times more."""
    return settings(
        max_examples=number * max(TIMES, 1), derandomize=not TIMES, database=None, deadline=None,
        suppress_health_check=list(HealthCheck), print_blob=True,
    )  # fmt: skip


class TooLongError(BaseException):
    """A file takes longer than it may."""


@contextmanager
def bounded() -> Iterator[None]:
    """End what takes longer than it may."""

    def end(*_: object) -> NoReturn:
        raise TooLongError(f"more than {MOST_S:g} s of processor time")

    before = signal.signal(signal.SIGPROF, end)
    signal.setitimer(signal.ITIMER_PROF, MOST_S if TIMES else 0.0)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


@pytest.fixture(autouse=True)
def little_memory() -> Iterator[None]:
    """Leave a campaign 1 GB beyond what the process has."""
    before = resource.getrlimit(resource.RLIMIT_AS)
    if TIMES:
        size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (size + MOST_BYTES, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_AS, before)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder that is the current one, and stays empty but for what a test names."""
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    return folder


@pytest.mark.parametrize("name", READERS)
def test_a_hostile_file_is_read_or_refused_with_a_code(name: str, here: Path) -> None:
    target = Target(name, here / "files")
    for example in target.examples:
        assert target.failure(example) == ""
        assert name in NOT_READ or target.succeeded
    for what, content in ONCE_FAILED.get(name, {}).items():
        assert target.failure(content) == "", what

    @examples(READERS[name].in_suite)
    @given(content=hostile(target.examples))
    def ends_well(content: bytes) -> None:
        with bounded():
            assert target.failure(content) == ""

    ends_well()
    assert [path.name for path in here.iterdir()] == ["files"]


def test_the_harness_sees_what_is_wrong(tmp_path: Path) -> None:
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


# --- devices ---


def test_every_kind_of_device_is_in_the_table() -> None:
    assert {name for names in BUILT_IN.values() for name in names} == devices.KINDS


@pytest.mark.parametrize("name", devices.TABLES)
def test_a_driver_raises_only_its_own_errors_in_bounded_time_and_moves_nothing(name: str) -> None:
    table = devices.TABLES[name]
    parser = devices.parser_of(table)
    for reply in REPLIES_ONCE_FAILED.get(name, {}).values():
        parser.hear([reply])

    @examples(CONVERSATIONS)
    @given(replies=devices.conversations(table))
    def ends_well(replies: list[devices.Reply]) -> None:
        parser.hear(replies)

    ends_well()


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
        (lambda bench: float("x"), ValueError),
        (lambda bench: ForceReading(math.nan, True, 0.0), AssertionError),
        (lambda bench: raise_(StageError("of another device")), AssertionError),
        (lambda bench: bench.clock.wait_s(60.0), AssertionError),
        (lambda bench: bench.wire.asked.append(bench.device.zero), AssertionError),
        (lambda bench: [bench.wire.read(0.0) for _ in range(devices.MOST_READS + 1)], AssertionError),
        (lambda bench: raise_(ForceError("its own")), None),
    ],
)
def test_a_parser_with_a_mistake_is_seen(
    mistake: Callable[[Connected], object], found: type[Exception] | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    parser = devices.ForceParser(next(one for one in devices.TABLES.values() if isinstance(one, ForceBytes)))
    made = parser._new

    def with_a_mistake() -> Connected:
        bench = made()
        bench.driver = Wrong(lambda: mistake(bench))
        return bench

    monkeypatch.setattr(parser, "_new", with_a_mistake)
    heard = devices.Reply(devices.SEALED, False, 0, b"")
    if found is None:
        parser.hear([heard])
    else:
        with pytest.raises(found):
            parser.hear([heard])
