"""A file is read, or says what it is and how to save it."""

import pickle
import struct
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.io
import scipy.sparse
from numpy.typing import NDArray

from rig.compare.exceptions import RecordingError
from rig.compare.recordings.reading import Reading, read_recordings
from tests.error_codes import raises
from tests.rig.compare.recording_files import (
    ALL,
    LOST_S,
    PULSES,
    RATES_CSV,
    RATES_ROWS,
    RISES,
    TIMES,
    TWICE,
    WINDOW_S,
    Case,
    amplifier,
    check,
    mat,
    nix,
    nwb,
    of_amplifier,
    run_with_pulses,
    text,
    xlsx,
)


def content(data: bytes, name: str) -> Callable[[Path], str]:
    def write(folder: Path) -> str:
        (folder / name).write_bytes(data)
        return str(folder / name)

    return write


def truncated(folder: Path) -> str:
    path = Path(of_amplifier(**PULSES)(folder))
    path.write_bytes(path.read_bytes()[:-500])
    return str(path)


def filtered(folder: Path) -> str:
    """Compressed by a filter that h5py does not have: the number of Zstandard, put where gzip's was."""
    path = folder / "synthetic.nwb"
    with h5py.File(path, "w") as file:
        file["units/id"] = [0]
        file["units/spike_times_index"] = [len(TIMES)]
        made = file.create_dataset("units/spike_times", (len(TIMES),), dtype="f8", chunks=True, compression="lzf")
        made.id.write_direct_chunk((0,), b"no compressed data", 0)
    path.write_bytes(path.read_bytes().replace((32000).to_bytes(2, "little"), (32015).to_bytes(2, "little")))
    return str(path)


def capitals(folder: Path) -> str:
    return str(Path(of_amplifier(**PULSES)(folder)).rename(folder / "SYNTHETIC.NWB"))


POSITIONS, THESE = np.array([-0.5, 0, 0.25, 1]), np.array(ALL)


def cells(values: Sequence[Any], *, row: bool = False) -> NDArray[Any]:
    """A cell array of MATLAB, as a column or a row."""
    made = np.empty((len(values), 1), dtype=object)
    made[:, 0] = values
    return made.T if row else made


SPIKES_IN_MAT = [(t, "spike", "1") for t in TIMES] + [(t + 0.1, "spike", "2") for t in TIMES]
MAT_TIMES = np.array([t for t, *_ in SPIKES_IN_MAT])
MAT_UNITS = [unit for *_, unit in SPIKES_IN_MAT]


def mat_spikes(choice: str = "", **more: Any) -> Callable[[Path], str]:
    """Spikes of two units, with the columns `more`."""
    return lambda folder: mat(time_s=MAT_TIMES, **more)(folder) + choice


def mat_object(folder: Path) -> str:
    """Positions, rates, and a variable `unit` of MATLAB's class string, which has no public format."""
    path = Path(mat(position_mm=POSITIONS, rate=THESE)(folder))

    def element(kind: int, data: bytes) -> bytes:
        return struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8)

    parts = element(6, struct.pack("<II", 17, 0)) + b"".join(element(1, one) for one in (b"note", b"MCOS", b"string"))
    workspace = element(6, struct.pack("<II", 9, 0)) + element(5, struct.pack("<ii", 1, 8)) + element(1, b"")
    workspace += element(2, bytes(8))
    path.write_bytes(path.read_bytes() + element(14, parts) + element(14, workspace))
    return str(path)


KINDS = {
    "UTF-16, tabs": Case("Excel's Unicode text", text(RATES_CSV.replace(",", "\t"), encoding="utf-16"), rates=ALL),
    "UTF-16, no mark": Case("it says what it is", content(RATES_CSV.encode("utf-16-le"), "a.csv"), code="no_csv",
                            says=("UTF-16", "CSV UTF-8")),
    "Latin-1": Case("it says what it is and how to save it", content("Höhe,rate\n0,1\n".encode("latin-1"), "a.csv"),
                    code="no_csv", says=("UTF-8", "Latin-1", "row 1")),
    "a title above the header": Case("it is no name of a column", text(f"Unit 3\n{RATES_CSV}"), code="no_column",
                                     says=("read Unit 3", "must begin with #")),
    "no header": Case("numbers are no names", text("-0.5,6\n0,24\n0.25,12\n"), code="no_header",
                      says=("row 1", "position_mm,rate")),
    "xlsx": Case("a table is a table", xlsx({"Sheet1": RATES_ROWS}), rates=ALL),
    "xlsx, texts in the cells": Case("a table is a table", xlsx({"Sheet1": RATES_ROWS}, inline=True), rates=ALL),
    "xlsx, units and an empty row": Case("as in a CSV", xlsx({"Sheet1": [
        [], ["Position (um)", "Rate (imp/s)", None], *([1000 * x, y] for x, y in RATES_ROWS[1:]), [None, None]
    ]}), rates=ALL),
    "xlsx, a line feed in a name": Case("Excel breaks long names", xlsx({"A": [
        ["Position\n(um)", "Rate"], *([1000 * x, y] for x, y in RATES_ROWS[1:])]}), rates=ALL),
    "xlsx, empty sheets": Case("only one has rows", xlsx({"A": [], "B": RATES_ROWS, "C": []}), rates=ALL),
    "xlsx, several sheets": Case("which of them?", xlsx({"A": RATES_ROWS, "B": RATES_ROWS}), code="several_sheets",
                                 says=("#A", "B")),
    "xlsx, a sheet": Case("chosen", xlsx({"A": RATES_ROWS[:3], "B": RATES_ROWS}, "#B"), rates=ALL),
    "xlsx, no such sheet": Case("listed", xlsx({"A": RATES_ROWS}, "#C"), code="no_sheet", says=("A",)),
    "xlsx, a cell that is no number": Case("named", xlsx({"A": [*RATES_ROWS[:2], [0, "x"]]}), code="no_number",
                                           says=("row 3", "rate", "'x'")),
    "xlsx, an empty cell": Case("named", xlsx({"A": [*RATES_ROWS[:2], [0.1], [0.2, 3]]}), code="no_number",
                                says=("row 3", "rate", "delete rows without data")),
    "xlsx, dates": Case("Excel made a date of 1.5", xlsx({"A": RATES_ROWS}, dates=True), code="no_number",
                        says=("a date",)),
    "xlsx, spikes of several units": Case(
        "a unit of a sheet", xlsx({"A": [["unit", "t (ms)"], *([u, 1e3 * t] for t in TIMES for u in "ab")]}, "#A#b"),
        rates=ALL, pulses=False,
    ),
    "xlsx, spikes of several units, none chosen": Case(
        "the error says how", xlsx({"A": [["unit", "t (ms)"], *([u, 1e3 * t] for t in TIMES for u in "ab")]}),
        code="several_units", says=("synthetic.xlsx#SHEET#UNIT", "a, b"), pulses=False,
    ),
    "xls": Case("it says what it is and how to save it",
                content(bytes.fromhex("d0cf11e0a1b11ae1") + 600 * b"\0", "a.xls"), code="no_csv",
                says=(".xls", "save")),
    "a zip that is no workbook": Case("it says what it is", content(b"PK\x03\x04" + 60 * b"\0", "a.xlsx"),
                                      code="no_csv", says=("ZIP",)),
    "mat": Case("vectors of one length are columns", mat(position_mm=POSITIONS, rate=THESE), rates=ALL),
    "mat, columns and a scalar": Case(
        "a scalar is the same in all rows",
        mat(x_um=1000 * POSITIONS[:, None], n=np.array([3, 12, 6, 1])[:, None], window_ms=250.0),
        ("position=x_um,count=n",), rates=[12, 48, 24, 4],
    ),
    **{
        f"mat, a scalar {name}": Case("a rate or a position is measured for each row", mat(
            **{"position_mm": POSITIONS, "rate": THESE, "sd": 1.0} | {name: 6.0}), code="same_in_all_rows",
            says=(name, "6", "vector"))
        for name in ("position_mm", "rate")
    },
    "mat, a scalar count": Case("a count is of one press", mat(position_mm=POSITIONS, count=6.0, window_s=1.0),
                                code="same_in_all_rows"),
    "mat, a scalar sd": Case("one sd for all", mat(position_mm=POSITIONS, rate=THESE, sd=1.0, repeat=1.0), rates=ALL),
    "mat, spike times": Case("a vector of times", mat(spike_times=1e3 * np.array(TIMES)), ("time=spike_times:ms",),
                             rates=ALL, pulses=False),
    **{
        f"mat, units in {what}": Case("the spikes of one of two units", mat_spikes("#1", unit=unit), ("sync=none",),
                                      rates=ALL, pulses=False, read_as="unit")
        for what, unit in {
            "a cell array of texts": cells(MAT_UNITS), "a row of cells": cells(MAT_UNITS, row=True),
            "cells of numbers": cells([float(one) for one in MAT_UNITS]), "rows of letters": np.array(MAT_UNITS),
            "numbers": np.array(MAT_UNITS, dtype=float),
        }.items()
    },
    "mat, units in a cell array, none chosen": Case("two units are not one", mat_spikes(unit=cells(MAT_UNITS)), (
        "sync=none",), code="several_units", says=("2 units", "1, 2"), pulses=False),
    "mat, one unit as a text": Case("it is that of all rows", lambda folder: mat(time_s=TIMES, unit="a1")(folder)
                                    + "#a1", ("sync=none",), rates=ALL, pulses=False),
    **{
        f"mat, {name} in a row of letters": Case("one name, or one for each row?", mat_spikes(
            **{name: "ab" * len(TIMES)}), ("sync=none",), code="not_understood",
            says=(f"column {name}", "a row of 86 letters", "N × 1", "cell array"), pulses=False)
        for name in ("unit", "kind")
    },
    "mat, repeats in a row of letters": Case("one name, or one for each row?", mat(
        position_mm=[x for x, *_ in TWICE], rate=[y for _, y, _ in TWICE], rep="11112222"), code="not_understood",
        says=("column rep", "a row of 8 letters", "N × 1")),
    **{
        f"mat, one repeat {said!r} for eight presses": Case("the column is there", mat(
            position_mm=[x for x, *_ in TWICE], rate=[y for _, y, _ in TWICE], rep=one), code="place_twice",
            says=("row 6", "first in row 2", "the column rep is there", f"one value for all rows, {said!r}"))
        for one, said in (("abc", "abc"), (1.0, "1"))
    },
    **{
        f"mat, units in {what}": Case("there, and not understood", mat_spikes(unit=unit), ("sync=none",),
                                      code="not_understood", says=("column unit", what, "one for each row"),
                                      pulses=False)
        for what, unit in {
            "a struct": {"a": 1.0}, "a sparse matrix": scipy.sparse.csc_matrix(MAT_TIMES[:, None]),
            "a complex vector": MAT_TIMES + 1j, "a logical vector": MAT_TIMES > 1, "an array of 86 × 2":
            np.ones((86, 2)), "a cell array of cells": cells([cells([1.0])] * 86),
        }.items()
    },
    "mat, kinds in cells": Case(
        "rows of kind start and stop limit the time, as in a CSV",
        mat(time_s=[0.0, *TIMES, LOST_S], kind=cells(["start", *["spike"] * len(TIMES), "stop"])),
        rates=ALL[:3], lost=2, pulses=False,
    ),
    "mat, pulses in cells": Case(
        "rows of kind sync are pulses", mat(time_s=np.concatenate([amplifier(TIMES), amplifier(RISES)]),
                                            kind=cells(["spike"] * len(TIMES) + ["sync"] * len(RISES))), rates=ALL,
    ),
    "mat, rates in cells": Case("a number in each", mat(position_mm=POSITIONS, rate=cells(ALL)), rates=ALL),
    "mat, a rate is an empty cell": Case("no data is not zero", mat(
        position_mm=POSITIONS, rate=cells([*ALL[:3], np.empty((0, 0))])), code="no_number",
        says=("row 5", "delete rows without data")),
    "mat, repeats and sd in cells": Case("which of the two?", mat(
        position_mm=[x for x, *_ in TWICE], rate=[y for _, y, _ in TWICE], sd=cells([9.0] * 8),
        repeat=cells([str(n) for *_, n in TWICE])), code="sd_and_repeats", says=("column sd",)),
    "mat, rates in a sparse matrix": Case("there, and not understood", mat(
        position_mm=POSITIONS, rate=scipy.sparse.csc_matrix(THESE)), code="not_understood",
        says=("column rate", "sparse", "full")),
    "mat, rejected presses in letters": Case("which of the presses?", mat(
        position_mm=POSITIONS, rate=THESE, rejected=np.array(["no", "no", "no", "yes"])), code="extra_column",
        says=("'rejected'",)),
    "MATLAB, logical": Case("true is no rate", mat(position_mm=POSITIONS, rate=THESE > 5), code="not_understood",
                            says=("column rate", "logical")),
    "MATLAB, a matrix": Case("its shape is said", mat(position_mm=POSITIONS, rate=np.ones((4, 2))),
                             code="not_understood", says=("4 × 2",)),
    "MATLAB, complex": Case("said", mat(position_mm=POSITIONS, rate=THESE + 1j), code="not_understood",
                            says=("complex",)),
    "MATLAB, version 4": Case("it says what it is", lambda folder: (
        scipy.io.savemat(folder / "a.mat", {"position_mm": POSITIONS, "rate": THESE}, format="4"),
        str(folder / "a.mat"))[1], code="no_csv", says=("version 4", "-v7")),
    "mat, a struct beside, ignored": Case("said", mat(position_mm=POSITIONS, rate=THESE, info={"a": 1.0}), (
        "position=position_mm",), rates=ALL, read_as="Not read: info."),
    "mat, an object beside, ignored": Case("said", mat_object, ("position=position_mm",), rates=ALL,
                                           read_as="Not read: note."),
    "mat, HDF5 without the words of MATLAB": Case(
        "as other programs write version 7.3", lambda folder: str(Path(nwb()(folder)).rename(folder / "a.mat")),
        code="no_csv", says=("HDF5", "-v7", "CSV"),
    ),
    "a pickle": Case("it may run any code", content(pickle.dumps([1.0]), "a.pkl"), code="no_csv",
                     says=("a pickle", "save the spikes as NIX, NWB or CSV")),
    "names of rows, as R writes them": Case(
        "the column has no name", text('"","position_mm","rate"\n"1",-1,6\n"2",0,24\n"3",1,12\n'),
        code="extra_column", says=("''", "row.names = FALSE"),
    ),
    "mat, an object beside": Case("said", mat_object, code="extra_column", says=("'note'",)),
    "mat, one column": Case("MATLAB has no lines", mat(position_mm=POSITIONS), code="no_column",
                            says=("rate is missing", "read position_mm;")),
    "mat, other lengths": Case("listed", mat(position_mm=POSITIONS, rate=THESE[:3]), code="no_mat_table",
                               says=("position_mm (4)", "rate (3)")),
    "mat, a struct": Case("listed", mat(s={"position_mm": POSITIONS, "rate": THESE}), code="no_mat_table",
                          says=("s (struct)", "-struct")),
    "mat 7.3": Case("it says what it is and how to save it", content(b"MATLAB 7.3 MAT-file" + 600 * b" ", "a.mat"),
                    code="no_csv", says=("7.3", "-v7")),
    "NWB called CSV": Case("it says what it is", lambda folder: str(
        Path(nwb()(folder)).rename(folder / "a.csv")), code="no_csv", says=("HDF5", ".nwb")),
    "CSV called NWB": Case("it says what it is", content(RATES_CSV.encode(), "a.nwb"), code="no_hdf5",
                           says=("text",)),
    "an empty NWB": Case("it says what it is", content(b"", "a.nwb"), code="no_hdf5", says=("empty",)),
    "a pointer of Git LFS": Case("it says what it is", content(
        b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 9\n", "a.nwb"), code="no_hdf5",
        says=("Git LFS",)),
    "NWB, truncated": Case("it is an NWB file, cut short", truncated, code="truncated_hdf5",
                           says=("truncated", "copy")),
    "NWB, an unknown filter": Case("it is an NWB file, compressed", filtered, code="unknown_filter",
                                   says=("units/spike_times", "32015", "h5repack")),
    ".NWB": Case("a capital is a letter", capitals, rates=ALL),
    "a unit of a table of rates": Case("nothing to choose from", lambda folder: text(RATES_CSV)(folder) + "#3",
                                       code="no_unit_here", says=("#3",)),
}  # fmt: skip
CASES = KINDS


@pytest.mark.parametrize("name", CASES)
def test_a_file_is_read_or_says_what_it_is(name: str, tmp_path: Path) -> None:
    check(CASES[name], tmp_path)


@pytest.mark.parametrize("suffix", ["nwb", "nix"])
def test_a_file_that_another_program_writes_says_so(suffix: str, tmp_path: Path) -> None:
    """HDF5 locks files: the amplifier's program has not closed this one."""
    path = {"nwb": of_amplifier(**PULSES), "nix": nix()}[suffix](tmp_path)
    hold = f"import h5py, sys; file = h5py.File({path!r}, 'a'); print('open', flush=True); sys.stdin.read()"
    with subprocess.Popen([sys.executable, "-c", hold], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        assert other.stdout is not None
        assert other.stdout.readline().strip() == b"open"
        with raises(RecordingError, "locked_hdf5", path=path) as caught:
            read_recordings([f"bar:3={path}"], [], [run_with_pulses(tmp_path)], Reading((0.0, WINDOW_S)))
        other.communicate()
    assert "another program" in str(caught.value)


@pytest.mark.parametrize("suffix", ["nwb", "nix"])
def test_a_truncated_file_of_any_kind_says_so(suffix: str, tmp_path: Path) -> None:
    path = Path({"nwb": of_amplifier(**PULSES), "nix": nix()}[suffix](tmp_path))
    path.write_bytes(path.read_bytes()[:-500])
    with raises(RecordingError, "truncated_hdf5", path=str(path)):
        read_recordings([f"bar:3={path}"], [], [run_with_pulses(tmp_path)], Reading((0.0, WINDOW_S)))
