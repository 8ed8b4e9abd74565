"""Every file that the program reads: a success, or its own error with a code, whatever is in the file.

In the suite 250 inputs for each quick reader, fewer for slow ones, and all that once failed. `make shake` runs
a million (tests/fuzz/campaign.py). The program reads in this process here; limits of time and memory are the
campaign's.
"""

from pathlib import Path

import pytest

from tests.fuzz.campaign import shares
from tests.fuzz.harness import Target
from tests.fuzz.once_failed import ONCE_FAILED
from tests.fuzz.readers import NOT_READ, READERS, failure_of

ONE_IN = 4
"""The suite reads one in four of the inputs by which a campaign is shared out: a quarter of thirty seconds."""


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder that is the current one, and stays empty but for what a test names."""
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    return folder


@pytest.mark.parametrize("name", READERS)
def test_a_reader_ends_well(name: str, here: Path) -> None:
    target = Target(name, here / "files")
    for example in target.examples:
        assert target.failure(example) == ""
        assert name in NOT_READ or target.succeeded
    failed = {}
    for seed in range(max(1, READERS[name].in_suite // ONE_IN)):
        if what := target.failure(target.mutated(seed)):
            failed[seed] = what
    assert failed == {}
    assert [path.name for path in here.iterdir()] == ["files"]


@pytest.mark.parametrize(("name", "what"), [(name, what) for name, files in ONCE_FAILED.items() for what in files])
def test_what_once_failed(name: str, what: str, here: Path) -> None:
    target = Target(name, here / "files")
    content = ONCE_FAILED[name][what]
    assert target.failure(target.mutated(content) if isinstance(content, int) else content) == ""


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
    each = shares(1_000_000, list(READERS))
    assert sum(each.values()) == pytest.approx(1_000_000, rel=1e-3)
    assert min(each.values()) >= 100
