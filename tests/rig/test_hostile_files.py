"""What every reader does with files that are made to harm: one line and no more than 5 s and 1 GB, or the content."""

import math
import os
import pickle
import shutil
import signal
import stat
import struct
import sys
import time
import zipfile
import zlib
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import pytest

from rig.cli.error_exit_codes import outcome
from rig.compare.plausible_fingers import read_plausible
from rig.compare.recordings.afferents_table import read_afferents
from rig.compare.recordings.columns import ColumnMap
from rig.compare.recordings.deflection import read_skin_deflection
from rig.compare.recordings.neo_file import read_neo
from rig.compare.recordings.nwb_file import read_nwb
from rig.compare.recordings.presses_table import read_srp
from rig.compare.recordings.reading import Reading, sha256
from rig.compare.recordings.spikes_table import read_spikes_table
from rig.control.stage_alone import stage_alone
from rig.data import RunFolder, read_run
from rig.data.run import Following
from rig.plan.config import load_config
from rig.plan.finger_file import read_finger_file
from rig.protocol.script import load_script
from rig.report.recording_sections import read_deflections
from rig.study.parameter_study import read_study
from rig_shared import user_files
from rig_shared.errors import CodedError, code_of
from sim.coding.readings_file import read_pressures, read_readings
from sim.config import FingertipConfig
from sim.contact.map_files import read_height_map
from sim.contact.measured_profile import read_profile
from sim.contact.shapes import contents

Read = Callable[[Path], Any]
SECONDS, GIGABYTES = 5.0, 1.0
SLOWER = 2.0
"""Machines that run the tests are slower."""


def _skin(key: str) -> Read:
    def read(path: Path) -> Any:
        config = path.with_name("names_it.toml")
        config.write_text(f'[finger.geometry]\n{key} = "{path.name}"\n', encoding="utf-8")
        return load_config(config)

    return read


def _in_run(read: Callable[[Path], Any]) -> Read:
    def in_folder(path: Path) -> Any:
        folder = path.with_name("run")
        folder.mkdir(exist_ok=True)
        (folder / "events.jsonl").symlink_to(Path("..") / path.name)
        return read(folder)

    return in_folder


READERS: dict[str, tuple[str, Read]] = {
    "configuration": (".toml", load_config),
    "configuration of a stop": (".toml", stage_alone),
    "finger": (".toml", read_finger_file),
    "plausible fingers": (".toml", read_plausible),
    "study": (".toml", read_study),
    "points of skin": (".csv", _skin("points")),
    "sections": (".csv", _skin("sections")),
    "script": (".py", lambda path: load_script(str(path))),
    "journal": (".jsonl", _in_run(read_run)),
    "journal in a list": (".jsonl", _in_run(lambda path: read_run(path, only=("mount",)))),
    "journal that grows": (".jsonl", _in_run(lambda path: Following(RunFolder(path)).new())),
    "rates": (".csv", read_srp),
    "workbook": (".xlsx", read_srp),
    "MATLAB": (".mat", read_srp),
    "spikes": (".csv", lambda path: read_spikes_table(path, "", ColumnMap())),
    "afferents": (".csv", lambda path: read_afferents(path, (), (), (), Reading())),
    "NWB": (".nwb", lambda path: read_nwb(path, "", ColumnMap())),
    "neo": (".plx", lambda path: read_neo(path, "", ColumnMap())),
    "deflection of skin": (".csv", read_skin_deflection),
    "deflections": (".csv", read_deflections),
    "SHA-256": (".csv", sha256),
    "profile": (".csv", lambda path: read_profile(str(path))),
    "table of a map": (".csv", lambda path: read_height_map(str(path), ["spacing_mm=0.1"])),
    "points of a map": (".csv", lambda path: read_height_map(str(path), [])),
    "array of a map": (".npy", lambda path: read_height_map(str(path), ["spacing_mm=0.1"])),
    "picture of a map": (".png", lambda path: read_height_map(str(path), ["width_mm=2", "height_mm=1"])),
    "readings": (".csv", lambda path: read_readings(path, FingertipConfig())),
    "pressures": (".csv", read_pressures),
}


# --- special files ---


def _socket(path: Path) -> None:
    os.mknod(path, stat.S_IFSOCK | 0o600)


SPECIAL: dict[str, Callable[[Path], object]] = {
    "pipe": os.mkfifo,
    "zeros": lambda path: path.symlink_to("/dev/zero"),
    "terminal": lambda path: path.symlink_to("/dev/ptmx"),
    "socket": _socket,
    "folder": Path.mkdir,
    "broken link": lambda path: path.symlink_to("nowhere"),
    "links in a circle": lambda path: path.symlink_to(path.name),
    "unreadable": lambda path: path.write_text("a", encoding="utf-8"),
}


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder, since a path to a socket must be short."""
    monkeypatch.chdir(tmp_path)
    return Path()


@pytest.mark.parametrize("special", SPECIAL)
def test_no_reader_opens_a_file_that_is_not_regular(
    here: Path, monkeypatch: pytest.MonkeyPatch, special: str
) -> None:
    real, hung = os.open, []

    def open_(path: Any, *arguments: Any, **options: Any) -> int:
        if special == "unreadable" and str(path).endswith(("hostile.csv", "events.jsonl", *suffixes)):
            raise PermissionError(13, "Permission denied", str(path))
        return real(path, *arguments, **options)

    suffixes = tuple(f"hostile{suffix}" for suffix, _ in READERS.values())
    monkeypatch.setattr(os, "open", open_)
    for number, (name, (suffix, read)) in enumerate(READERS.items()):
        if (special, name) in {("folder", "neo"), ("folder", "SHA-256"), ("folder", "afferents")}:
            continue  # these read folders
        if (special, name) == ("broken link", "journal that grows"):
            continue  # it waits for the file
        if special == "unreadable" and name in ("script", "neo"):
            continue  # the interpreter and neo open these
        Path(str(number)).mkdir()
        path = Path(str(number)) / f"hostile{suffix}"
        SPECIAL[special](path)
        with _alarm(SECONDS):
            try:
                read(path)
                hung.append((name, "was read"))
            except _Late:
                hung.append((name, "hangs"))
            except Exception as error:
                if _line_of(error) is None:
                    hung.append((name, repr(error)))
    assert not hung
    assert contents([f"profile:{path}"]) == ["missing"] if path.suffix == ".csv" else True


def _line_of(error: BaseException) -> str | None:
    """Return the line that a command prints of an error, or None for one that it does not expect."""
    found = outcome(error) if isinstance(error, Exception) and not isinstance(error, CodedError) else (str(error),)
    return None if found is None or "\n" in found[0] else found[0]


class _Late(BaseException):
    """Raised by the alarm."""


class _alarm:  # noqa: N801
    def __init__(self, seconds: float) -> None:
        self._seconds = seconds

    def __enter__(self) -> None:
        def late(*_: object) -> None:
            raise _Late

        signal.signal(signal.SIGALRM, late)
        signal.setitimer(signal.ITIMER_REAL, self._seconds)

    def __exit__(self, *_: object) -> None:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, signal.SIG_DFL)


def test_a_file_that_grows_while_being_read_is_read_up_to_the_limit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "grows"
    path.write_bytes(b"a" * 5000)
    real = os.fstat
    shrunk = lambda number: os.stat_result((*real(number)[:6], 10, *real(number)[7:]))  # noqa: E731
    monkeypatch.setattr(os, "fstat", shrunk)
    assert user_files.read_bytes(path, 5000) == b"a" * 5000
    with pytest.raises(OSError, match="limit"):
        user_files.read_bytes(path, 4999)


# --- bombs ---

Make = Callable[[Path], object]
OK = "ok"


def _sparse(path: Path) -> None:
    with path.open("wb") as file:
        file.truncate(10**9)


def _repeated(head: bytes, row: bytes, rows: int) -> Make:
    def make(path: Path) -> None:
        with path.open("wb") as file:
            file.write(head)
            for _ in range(rows // 100_000):
                file.write(row * 100_000)

    return make


def _text(text: Callable[[], str]) -> Make:
    """Make it when it is written: every process that collects the tests would make all of them."""
    return lambda path: path.write_text(text(), encoding="utf-8")


def _unpacks() -> bytes:
    """Return 10⁹ zeros compressed, as one block a hundred times."""
    block, end = (zlib.compressobj(9, wbits=-zlib.MAX_WBITS) for _ in range(2))
    blocks = 100 * (block.compress(bytes(10**7)) + block.flush(zlib.Z_FULL_FLUSH))
    return b"\x78\xda" + blocks + end.flush() + struct.pack(">HH", 10**9 % 65_521, 1)  # and their Adler-32


def _png(chunks: Callable[[], list[tuple[bytes, bytes]]]) -> Make:
    def make(path: Path) -> None:
        each = [struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
                for kind, data in chunks()]  # fmt: skip
        path.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(each))

    return make


def _npy(shape: str) -> Make:
    def make(path: Path) -> None:
        header = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
        path.write_bytes(b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header.encode() + b"\0" * 64)

    return make


def _nwb(change: Callable[[h5py.File], object]) -> Make:
    def make(path: Path) -> None:
        with h5py.File(path, "w", libver="latest") as file:
            file["units/id"] = [7]
            file["units/spike_times"] = [0.5, 1.5]
            file["units/spike_times_index"] = [2]
            change(file)

    return make


def _times(file: h5py.File, **options: Any) -> h5py.Dataset:
    del file["units/spike_times"]
    return file["units"].create_dataset("spike_times", **options)


def _external(file: h5py.File) -> None:
    del file["units/spike_times"]
    os.mkfifo(Path(file.filename).with_name("pipe.nwb"))
    file["units/spike_times"] = h5py.ExternalLink("pipe.nwb", "/a")


def _declared(file: h5py.File) -> None:
    _times(file, shape=(10**12,), dtype="f8", chunks=(10_000,), compression="gzip")
    file["units/spike_times_index"][:] = 10**12


def _workbook(part: str, *, head: bytes = b"", fill: bytes = b" ", many: int = 0) -> Make:
    """A workbook one part of which unpacks to much."""

    def make(path: Path) -> None:
        main = 'xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"'
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
            file.writestr(
                "xl/workbook.xml", f'<workbook {main}><sheets><sheet name="a" a="{{b}}id"/></sheets></workbook>'
            )
            file.writestr("xl/_rels/workbook.xml.rels", "<Relationships/>")
            with file.open(part, "w", force_zip64=True) as inside:
                inside.write(head)
                for _ in range(many):
                    inside.write(fill)

    return make


def _matlab(path: Path) -> None:
    """10⁹ zeros in a compressed variable of a few megabytes."""
    made = zlib.compressobj(1)
    size = 8 * 10**9
    head = struct.pack("<IIIIII", 14, (size + 48) % 2**32, 6, 8, 6, 0)
    head += (
        struct.pack("<IIii", 5, 8, 10**9, 1) + struct.pack("<HHI", 1, 1, 0x61) + struct.pack("<II", 9, size % 2**32)
    )
    zeros = b"".join(made.compress(bytes(10**7)) for _ in range(100))
    packed = made.compress(head) + zeros + made.flush()
    start = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x0100) + b"IM"
    path.write_bytes(start + struct.pack("<II", 15, len(packed)) + packed)


NESTED, DIGITS = 100_000, 100_000
ROWS = 10_000_000
PIXELS = (b"IHDR", struct.pack(">IIBBBBB", 20, 20, 8, 0, 0, 0, 0))

BOMBS: dict[str, tuple[Make, tuple[str, ...], tuple[str, ...]]] = {
    "1 GB without a line end": (_sparse, tuple(name for name in READERS if name not in
                                ("SHA-256", "script", "journal in a list")), ()),
    "nested arrays": (_text(lambda: f"a = {'[' * NESTED}"), ("configuration", "configuration of a stop", "finger",
                      "plausible fingers", "study"), ("no_toml",)),
    "nested tables": (_text(lambda: f"a = {'{a=' * NESTED}"), ("configuration", "configuration of a stop", "finger",
                      "plausible fingers", "study"), ("no_toml",)),
    "nested journal": (_text(lambda: f"{'[' * NESTED}\n{'[' * NESTED}\n"), ("journal", "journal in a list",
                       "journal that grows"), ("no_start", OK)),
    "a long line of a journal": (_text(lambda: '{"doc": "start", "a": [' + "{}," * 2_000_000 + "{}]}\n"),
                                 ("journal", "journal in a list", "journal that grows"), ("no_start", "long_line")),
    "10⁷ rates": (_repeated(b"position_mm,rate,repeat\n", b"0,2,3\n", ROWS), ("rates",), ("unreadable",)),
    "10⁷ rows": (_repeated(b"x_mm,height_mm\n", b"0,2\n", ROWS), ("profile", "points of skin", "sections",
                 "readings", "pressures", "points of a map", "table of a map"), ()),
    "10⁶ columns": (_text(lambda: ",".join(["a"] * 1_000_000) + "\n" + ",".join(["1"] * 1_000_000)),
                    ("rates", "spikes", "afferents", "deflections", "profile", "points of skin", "readings",
                     "pressures", "table of a map"), ()),
    "a map of 8 TB": (_npy("(1000000, 1000000)"), ("array of a map",), ("no_array",)),
    "pixels that unpack": (_png(lambda: [PIXELS, (b"IDAT", _unpacks()), (b"IEND", b"")]),
                           ("picture of a map",), ()),
    "10¹² values": (_nwb(_declared), ("NWB",), ("too_many_values",)),
    "another file": (_nwb(_external), ("NWB",), ("elsewhere",)),
    "texts that unpack": (_workbook("xl/sharedStrings.xml", fill=bytes(10**7), many=40), ("workbook",), ("no_csv",)),
    "zeros that unpack": (_matlab, ("MATLAB",), ("no_csv", "no_mat_table")),
}  # fmt: skip


def _peak_kb(*, from_now: bool = False) -> int:
    """Return the peak of this process's memory, and perhaps forget what was before."""
    if from_now:
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    return int(Path("/proc/self/status").read_text(encoding="ascii").split("VmHWM:")[1].split()[0])


def _in_a_child(calls: list[Callable[[], object]]) -> list[tuple[str, float, float]]:
    """Return code, processor seconds, and peak of memory in GB above the beginning, of calls in one other process."""
    import resource  # only of POSIX systems

    read_end, write_end = os.pipe()
    if (child := os.fork()) == 0:
        _, most = resource.getrlimit(resource.RLIMIT_CPU)
        before_kb = _peak_kb(from_now=True)
        for call in calls:
            signal.setitimer(signal.ITIMER_REAL, 120)  # a pipe that blocks uses no processor
            begun_s = time.process_time()
            resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(begun_s + SECONDS * SLOWER), most))
            _peak_kb(from_now=True)
            found = OK
            try:
                call()
            except BaseException as error:
                found = code_of(error) if _line_of(error) is not None else f"unforeseen: {error!r:.500}"
            used_s = time.process_time() - begun_s
            os.write(write_end, pickle.dumps((found, used_s, (_peak_kb() - before_kb) / 1e6)))
        os._exit(0)
    os.close(write_end)
    said = []
    with open(read_end, "rb") as file:
        while file.peek(1):  # type: ignore[attr-defined]
            said.append(pickle.load(file))
    os.waitpid(child, 0)
    return said + [("killed", SECONDS * SLOWER, 0.0)] * (len(calls) - len(said))


@pytest.mark.skipif(sys.platform != "linux", reason="measures memory by /proc")
@pytest.mark.quick(rows=lambda bomb: not bomb.startswith("1 GB"))
@pytest.mark.parametrize("bomb", BOMBS)
def test_a_decompression_bomb_is_refused_within_time_and_memory_limits(tmp_path: Path, bomb: str) -> None:
    make, readers, codes = BOMBS[bomb]
    made: dict[str, Path] = {}
    calls = []
    for number, (suffix, read) in enumerate(READERS[name] for name in readers):
        folder = tmp_path / str(number)
        folder.mkdir()
        path = folder / f"hostile{suffix}"
        if suffix in made:
            path.hardlink_to(made[suffix])
        else:
            make(path)
            made[suffix] = path
        calls.append(partial(read, path))
    wrong = []
    for name, (code, seconds, gigabytes) in zip(readers, _in_a_child(calls), strict=True):
        print(f"{bomb:28} {name:26} {code:20} {seconds:6.2f} s {gigabytes:5.2f} GB")
        foreseen = code not in ("killed",) and not code.startswith("unforeseen") and (not codes or code in codes)
        if gigabytes > GIGABYTES or not foreseen:
            wrong.append((name, code, seconds, gigabytes))
    shutil.rmtree(tmp_path)
    assert not wrong
