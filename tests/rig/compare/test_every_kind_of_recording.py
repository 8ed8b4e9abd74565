"""One afferent in every kind of file: read alike, and refused alike, in one line that names file and place."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from rig.compare.comparison import compare
from rig.compare.exceptions import RecordingError
from rig.compare.recordings.columns import column_map
from rig.compare.recordings.reading import Reading, read_recordings
from rig.compare.recordings.recording import Recording
from rig.compare.stimuli import StimulusRow
from rig.data import Run
from tests.error_codes import raises
from tests.rig.compare.recording_files import PRESSES, REPEAT, SPIKES, TIMES, WINDOW_S, journal

Cells = list[list[str]]


@dataclass(frozen=True)
class Kind:
    """A kind of file: its cells below a header, the column of what was measured, and how --columns names it."""

    header: tuple[str, ...]
    cells: Cells
    measured: str
    columns: tuple[str, ...] = ()
    separator: str = ","
    suffix: str = "csv"
    changes: tuple[str, ...] = ()
    window_s: float | None = WINDOW_S

    @property
    def nwb(self) -> bool:
        return self.suffix == "nwb"

    @property
    def spikes(self) -> bool:
        return len(self.cells) == len(TIMES)

    @property
    def place(self) -> int:
        return self.header.index(self.measured)

    def path(self, folder: Path) -> Path:
        return folder / f"afferent.{self.suffix}"

    def written(self, folder: Path) -> Path:
        path = self.path(folder)
        if self.nwb:
            self._as_nwb(path)
        else:
            lines = [self.separator.join(row) for row in (self.header, *self.cells)]
            path.write_text("\n".join(lines) + "\n", encoding="utf-8")
        return path

    def _as_nwb(self, path: Path) -> None:
        (values,) = zip(*self.cells, strict=True) if self.cells else ((),)
        try:
            times = np.array(values, dtype=float)
        except ValueError:
            times = np.array(values, dtype="S8")
        with h5py.File(path, "w") as file:
            file["units/id"] = [7]
            file[f"units/{self.header[0]}"] = times
            file[f"units/{self.header[0]}_index"] = [len(times)]

    def with_cell(self, row: int, text: str) -> "Kind":
        cells = [list(one) for one in self.cells]
        cells[row][self.place] = text
        return replace(self, cells=cells)

    @property
    def dataset(self) -> str:
        """How a complaint names what was measured in an NWB file."""
        return f"unit 7, column {self.measured}"


def column(*columns: list[str]) -> Cells:
    return [list(row) for row in zip(*columns, strict=True)]


def of(values: list[float], factor: float = 1.0, decimal: str = ".") -> list[str]:
    return [f"{factor * value:.9g}".replace(".", decimal) for value in values]


X = [x for x, _, _ in PRESSES]
COUNTS = [float(count) for _, count, _ in PRESSES]
RATES = [count / WINDOW_S for count in COUNTS]
LABEL = ["a"] * len(PRESSES)

KINDS = {
    "rates": Kind(("position_mm", "rate", "repeat"), column(of(X), of(RATES), REPEAT), "rate", window_s=None),
    "rates, decimal commas": Kind(
        ("position_mm", "rate", "repeat"), column(of(X, decimal=","), of(RATES), REPEAT), "rate", (), ";",
        window_s=None,
    ),
    "rates, tabs": Kind(
        ("repeat", "rate", "position_mm"), column(REPEAT, of(RATES), of(X)), "rate", (), "\t", window_s=None
    ),
    "rates, named": Kind(
        ("who", "x", "FR (1/ms)", "press"), column(LABEL, of(X, 1000), of(RATES, 0.001), REPEAT), "FR (1/ms)",
        ("position=x:um", "rate=FR (1/ms),repeat=press"), changes=("position from um", "rate from 1/ms"),
        window_s=None,
    ),
    "counts": Kind(
        ("position_mm", "count", "window_s", "repeat"), column(of(X), of(COUNTS), ["0.5"] * 8, REPEAT), "count"
    ),
    "counts, named": Kind(
        ("x [cm]", "n", "press", "who"), column(of(X, 0.1, ","), of(COUNTS), REPEAT, LABEL), "n",
        ("position=x [cm],count=n,window=500:ms,repeat=press",), ";",
        changes=("position from cm", "window from ms"),
    ),
    "counts, windows named": Kind(
        ("position_mm", "count", "w_ms", "repeat"), column(of(X), of(COUNTS), ["500"] * 8, REPEAT), "count",
        ("window=w_ms",), changes=("window from ms",),
    ),
    "spikes": Kind(("time_s",), column(of(TIMES)), "time_s"),
    "spikes, named": Kind(
        ("what", "t", "who"), column(["spike"] * len(TIMES), of(TIMES, 1000, ","), ["a"] * len(TIMES)), "t",
        ("time=t:ms,kind=what",), ";", changes=("time from ms",),
    ),
    "NWB": Kind(("spike_times",), column(of(TIMES)), "spike_times", suffix="nwb"),
    "NWB, named": Kind(
        ("sorted_ms",), column(of(TIMES, 1000)), "sorted_ms", ("time=sorted_ms",), suffix="nwb",
        changes=("time from ms",),
    ),
}  # fmt: skip

every_kind = pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)


def read(kind: Kind, folder: Path, *, mirror: bool = False, run: Run | None = None) -> Recording:
    """As the command does."""
    path = kind.written(folder)
    reading = Reading((0.0, WINDOW_S), 0.0, column_map(kind.columns))
    found = read_recordings([f"bar:3.0={path}"], ["bar:3"] * mirror, [run or journal(folder)], reading)
    assert list(found) == ["bar:3"]
    return found["bar:3"]


def refused(kind: Kind, folder: Path, code: str, *, run: Run | None = None, **fields: Any) -> None:
    """In one line, for this reason; fields are the file's path, unless columns are wrong whatever the file."""
    about = {} if code == "unused_column" else {"path": str(kind.path(folder))}
    with raises(RecordingError, code, **about, **fields) as caught:
        read(kind, folder, run=run)
    assert "\n" not in str(caught.value)


@every_kind
def test_the_same_afferent_whatever_the_file(kind: Kind, tmp_path: Path) -> None:
    found = read(kind, tmp_path)
    np.testing.assert_allclose(found.position_mm, list(SPIKES), atol=1e-9)
    np.testing.assert_allclose(found.repeats, np.array(list(SPIKES.values())) / WINDOW_S)
    np.testing.assert_allclose(found.sd, np.std(np.array(list(SPIKES.values())) / WINDOW_S, axis=1, ddof=1))
    assert found.window_s == (None if kind.window_s is None else pytest.approx(WINDOW_S))
    assert found.changes == kind.changes
    assert len(found.sha256) == 64


@every_kind
def test_mirrored_and_normalised(kind: Kind, tmp_path: Path, make_stimulus: Callable[..., StimulusRow]) -> None:
    found = read(kind, tmp_path, mirror=True)
    np.testing.assert_allclose(found.position_mm, [-1, -0.25, 0, 0.5], atol=1e-9)
    np.testing.assert_allclose(found.rate, [1, 12, 24, 6])
    assert found.changes == (*kind.changes, "mirrored")
    stimulus = make_stimulus("bar:3.0", np.array([-1.0, 1.0]), np.array([0.0]), {})
    (overlay,) = compare([stimulus], {"bar:3": found}, normalize=True).overlays
    np.testing.assert_allclose(overlay.recording.rate, np.array([1, 12, 24, 6]) / 24)
    assert overlay.recording.changes == (*kind.changes, "mirrored", "rates divided by 24")


@every_kind
@pytest.mark.parametrize("text", ["x", "nan", "", "1.2.3", "1.234,5"])
def test_a_cell_that_is_no_number(kind: Kind, tmp_path: Path, text: str) -> None:
    if (kind.nwb and text not in ("x", "nan", "inf")) or (text == "" and len(kind.header) == 1):
        pytest.skip("numbers are not text there, and an empty row is none")
    if "," in text and kind.separator == ",":
        text = f'"{text}"'
    wrong = kind.with_cell(1, text)
    if kind.nwb and text == "x":
        refused(wrong, tmp_path, "no_numbers", dataset=kind.dataset, dtype="|S8")
    elif kind.nwb:
        refused(wrong, tmp_path, "not_finite", dataset=kind.dataset, entry=2, value=text)
    else:
        refused(wrong, tmp_path, "no_number", row=3, column=kind.measured, cell=text.strip('"'))


@every_kind
def test_without_the_column_of_what_was_measured(kind: Kind, tmp_path: Path) -> None:
    header = tuple("other" if name == kind.measured else name for name in kind.header)
    without = replace(kind, header=header, measured="other")
    if kind.nwb:
        refused(without, tmp_path, "no_spike_times", column=kind.measured)
    else:
        refused(without, tmp_path, "no_column")


@every_kind
def test_a_file_with_nothing_in_it(kind: Kind, tmp_path: Path) -> None:
    empty = replace(kind, cells=[])
    if kind.spikes:
        refused(empty, tmp_path, "no_spikes")
    elif {"window_s", "w_ms"} & set(kind.header):
        refused(empty, tmp_path, "no_rows", expected="counts")
    else:
        refused(empty, tmp_path, "few_positions", positions=0, fewest=3)


@every_kind
def test_two_places_are_no_profile(kind: Kind, tmp_path: Path) -> None:
    few = kind if kind.spikes else replace(kind, cells=kind.cells[:4])
    refused(few, tmp_path, "few_positions", run=journal(tmp_path, presses=4), positions=2, fewest=3)


@every_kind
@pytest.mark.parametrize("what", ["missing", "a folder", "bytes"])
def test_what_is_no_such_file(kind: Kind, tmp_path: Path, what: str) -> None:
    path = tmp_path / f"no.{kind.suffix}"
    if what == "a folder":
        path.mkdir()
    if what == "bytes":
        path.write_bytes(b"\xff\xfe\x00")
    code, fields = {
        "missing": ("unreadable", {"reason": "No such file or directory"}),
        "a folder": ("unreadable", {"reason": "Is a directory"}),
        "bytes": ("no_hdf5" if kind.nwb else "no_csv", {}),
    }[what]
    with raises(RecordingError, code, path=str(path), **fields):
        read_recordings([f"bar:3={path}"], [], [journal(tmp_path)], Reading(columns=column_map(kind.columns)))


@every_kind
def test_a_name_that_no_file_is_read_by(kind: Kind, tmp_path: Path) -> None:
    role = "repeat" if kind.spikes else "kind"
    more = replace(kind, columns=(*kind.columns, f"{role}=other"))
    in_table = "count, position, repeat, window" if kind.window_s else "position, rate, repeat, sd"
    used = (
        "invalid, observed, sync, time"
        if kind.nwb
        else "kind, observed, sync, time, unit"
        if kind.spikes
        else in_table
    )
    refused(more, tmp_path, "unused_column", role=role, column="other", roles=used)


@every_kind
def test_other_columns_are_read_over_only_where_some_are_named(kind: Kind, tmp_path: Path) -> None:
    if kind.nwb:
        pytest.skip("a table of units has whatever columns it has")
    more = replace(kind, header=(*kind.header, "colour"), cells=[[*row, "red"] for row in kind.cells])
    if kind.columns:
        np.testing.assert_allclose(read(more, tmp_path).rate, read(kind, tmp_path).rate)
    else:
        refused(more, tmp_path, "extra_column", column="colour")


@every_kind
def test_rows_of_another_length_and_a_column_twice(kind: Kind, tmp_path: Path) -> None:
    if kind.nwb:
        pytest.skip("a table of units has no such rows")
    longer = [row if n != 1 else [*row, "1"] for n, row in enumerate(kind.cells)]
    n = len(kind.header)
    refused(replace(kind, cells=longer), tmp_path, "cells_of_row", row=3, cells=n + 1, columns=n)
    twice = replace(kind, header=(*kind.header, kind.measured), cells=[[*row, "1"] for row in kind.cells])
    refused(twice, tmp_path, "extra_column", column=kind.measured)
