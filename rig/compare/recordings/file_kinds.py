"""What a file is, by its first bytes, in words for messages."""

import struct
from pathlib import Path

from rig.compare.exceptions import RecordingError

HDF5 = b"\x89HDF\r\n\x1a\n"
ZIP = b"PK\x03\x04"
MATLAB, MATLAB_73 = b"MATLAB 5.0", b"MATLAB 7.3"
UTF_16 = (b"\xff\xfe", b"\xfe\xff")

_PICKLE = "a pickle of Python, which is not read, as it can run any code; save the spikes as NIX, NWB or CSV"
_KINDS = (
    (
        HDF5,
        "an HDF5 file; the names of NWB files must end in .nwb, and files of MATLAB 7.3 must be saved with "
        "save(…, '-v7'), or as CSV",
    ),
    (MATLAB_73, "a MATLAB file of version 7.3; save it in MATLAB with save(…, '-v7')"),
    (MATLAB, "a MATLAB file; its name must end in .mat"),
    (bytes.fromhex("d0cf11e0a1b11ae1"), "an Excel file of the old kind (.xls); save it as .xlsx or CSV UTF-8"),
    (ZIP, "a ZIP archive or a workbook of another program; save it as .xlsx or CSV UTF-8"),
    (b"\x1f\x8b", "compressed with gzip; unpack it"),
    (b"%PDF", "a PDF"),
    *((bytes((128, version)), _PICKLE) for version in range(2, 6)),
    (b"version https://git-lfs", "a pointer of Git LFS instead of the file; fetch it with git lfs pull"),
    (b"<!doctype", "a page of a website"),
    (b"<html", "a page of a website"),
)
_MOST_BYTES = 4096
_HDF5_PLACES = (0, 512, 1024, 2048)


def is_hdf5(start: bytes) -> bool:
    """Return whether a file is HDF5; MATLAB and others write a block of their own before it."""
    return any(start[at : at + len(HDF5)] == HDF5 for at in _HDF5_PLACES)


def is_matlab_4(start: bytes) -> bool:
    """Return whether a file with the suffix of MATLAB is of version 4, which has no signature."""
    if len(start) < _MATLAB_4:
        return False
    for order in "<>":
        kind, rows, columns, imaginary, letters = struct.unpack_from(f"{order}5i", start)
        if 0 <= kind < 5000 and min(rows, columns) >= 0 and imaginary in (0, 1) and 1 < letters <= 64:
            return True
    return False


_MATLAB_4 = 20


def kind_of(start: bytes) -> str:
    """Return what a file is, by its first bytes; "" if they do not tell."""
    if not start:
        return "empty"
    if start.startswith(MATLAB_73):
        return dict(_KINDS)[MATLAB_73]
    if is_hdf5(start):
        return dict(_KINDS)[HDF5]
    found = next((words for sign, words in _KINDS if start[: len(sign)].lower() == sign.lower()), "")
    if found or start.startswith(UTF_16):
        return found
    few = start[:_MOST_BYTES]
    zeros = [few[k::2].count(0) for k in (0, 1)]
    if max(zeros) > len(few) // 4 and min(zeros) == 0:
        return "text in UTF-16 without its mark; save it as CSV UTF-8"
    if 0 in few:
        return ""
    try:
        few.decode("utf-8")
    except UnicodeDecodeError as error:
        return "" if error.start < len(few) - 4 else "text"
    return "text"


def no_table(path: Path, kind: str, reason: str = "") -> RecordingError:
    """Return the error for a file that is no table: what it is (a `kind`), or why its text cannot be read."""
    if kind and kind != "text":
        return RecordingError(f"{path}: not a table (CSV in UTF-8, .xlsx, .mat); it is {kind}", "no_csv")
    return RecordingError(f"{path}: not a CSV file in UTF-8: {reason}; save it as CSV UTF-8", "no_csv")
