"""Files that once failed, by reader, and replies, by device: what each is, and its content."""

import io
import sqlite3
import struct
import zlib
from collections.abc import Callable
from contextlib import closing

import h5py
import numpy as np

from rig.data.index import _MARK
from tests.fuzz.devices import PATCHED, SEALED, Reply
from tests.fuzz.readers import MAP_POINTS, MAP_ROWS, RATES, ROW

DEEP = 20_000


def _nwb(change: Callable[[h5py.File], None]) -> bytes:
    """Return a file of one unit with three spikes, changed."""
    stream = io.BytesIO()
    with h5py.File(stream, "w") as file:
        file["units/id"] = [7]
        file["units/spike_times"] = [1.0, 2.0, 3.0]
        file["units/spike_times_index"] = [3]
        change(file)
    return stream.getvalue()


def _instead(name: str, value: object) -> Callable[[h5py.File], None]:
    def change(file: h5py.File) -> None:
        if name in file:
            del file[name]
        file[name] = value

    return change


def _group(file: h5py.File) -> None:
    del file["units/id"]
    file.create_group("units/id")


def _npy(header: str) -> bytes:
    """Return a NumPy file whose header is any text."""
    text = header.encode().ljust(118) + b"\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + bytes(320)


def _png(*chunks: tuple[bytes, bytes]) -> bytes:
    """Return a picture of 4 × 4 pixels, after any other chunks."""
    size = (b"IHDR", struct.pack(">IIBBBBB", 4, 4, 8, 0, 0, 0, 0))
    first = [] if chunks[0][0] == b"IHDR" else [size]
    whole = [*first, *chunks, (b"IDAT", zlib.compress(bytes(20))), (b"IEND", b"")]
    parts = (
        struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
        for kind, body in whole
    )
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


def _event(data: str, stream: str = '"mount"', t_s: str = "0.0") -> bytes:
    """Return a journal of a start, a mutated event, and a whole one."""
    start = (
        '{"doc": "start", "uid": "a", "seq": 0, "t_s": 0.0, "unix_s": 1.0, "protocol": "p", "title": "t", '
        '"source": "", "parameters": {}, "planned_indentations": 1, "subject": null, "virtual": true}\n'
    )
    event = (
        f'{{"doc": "event", "uid": "b", "seq": 1, "t_s": {t_s}, "unix_s": 1.0, "stream": {stream}, "data": {data}}}\n'
    )
    return (start + event + event.replace(data, '{"indentor": "bar:3.0"}')).encode()


def _index(summary: bytes) -> bytes:
    """Return an index of one run, whose summary is not checked by SQLite."""
    with closing(sqlite3.connect(":memory:")) as index:
        index.execute("CREATE TABLE runs (name TEXT PRIMARY KEY, mark TEXT, summary TEXT, holds TEXT, sum INTEGER)")
        index.execute(f"PRAGMA user_version = {_MARK}")
        index.execute("INSERT INTO runs VALUES ('complete', '', CAST(? AS TEXT), '[]', 0)", (summary,))
        index.commit()
        return index.serialize()


_FINGER = b"[identified]\n[finger]\n"

ONCE_FAILED: dict[str, dict[str, bytes]] = {
    "configuration": {
        "lists nested too deeply": b"a = " + b"[" * DEEP,
        "an integer of 5 000 digits": b"a = " + b"1" * 5000,
        "a key of 20 000 parts": b"a." * DEEP + b"a = 1",
        "a key of 20 000 quoted parts": b"'a b' . " * DEEP + b"a = 1",
    },
    "configuration, for a stop": {"tables nested too deeply": b"[stage]\na = " + b"{a=" * DEEP},
    "identified finger": {"[virtual] is a list": b"virtual = []\n" + _FINGER},
    "plausible fingers": {
        "an integer of 5 000 digits": b"a = " + b"1" * 5000, "[virtual] is a number": b"virtual = 1.5\n" + _FINGER
    },
    "parameter study": {"lists nested too deeply": b"[finger]\na = " + b"[" * DEEP},
    "height map of points": {
        "points apart by less than an atom": "\n".join(
            f"{x}e-9,{z}e-9,0" if n else "x_mm,z_mm,height_mm"
            for n, (x, z) in enumerate([(0, 0), *((x, z) for x in range(3) for z in range(3))])
        ).encode(),
        "a height of 1e300 mm": MAP_POINTS.replace("0.2", "1e300").encode(),
    },
    "height map of rows": {"a height of 1e300 mm": MAP_ROWS.replace("0.325", "1e308", 1).encode()},
    "height map, NumPy": {
        "a shape that is not closed": _npy("{'descr': '<f8', 'fortran_order': False, 'shape': (4, 4"),
        "a shape of texts": _npy("{'descr': '<f8', 'fortran_order': False, 'shape': ('a', 2)}"),
        "a shape of truths": _npy("{'descr': '<f8', 'fortran_order': False, 'shape': (True, 2)}"),
    },
    "height map, picture": {
        "an animation without frames": _png((b"acTL", bytes(8))),
        "a color profile without a method": _png((b"iCCP", b"")),
        "half the size that is a bomb": _png((b"IHDR", struct.pack(">IIBBBBB", 10_000, 10_000, 8, 0, 0, 0, 0))),
    },
    "table of rates or counts": {"a rate of 1e308": RATES.replace("30", "1e308").encode()},
    "spike times": {
        "all pulses at one time": b"time_s,kind\n1,spike\n" + b"5,sync\n" * 4,
        "all pulses at one late time": b"time_s,kind\n1,spike\n" + b"1e18,sync\n" * 4,
    },
    "spike times, NWB": {
        "a link to itself": _nwb(_instead("units/id", h5py.SoftLink("/units/id"))),
        "a link to nowhere": _nwb(_instead("units/id", h5py.SoftLink("/nowhere"))),
        "a link to another file": _nwb(_instead("units/spike_times", h5py.ExternalLink("nowhere.h5", "/"))),
        "a group instead of a list": _nwb(_group),
        "a number instead of a list": _nwb(_instead("units/spike_times", 1.0)),
        "rows and columns": _nwb(_instead("units/spike_times", np.ones((2, 2)))),
        "no values": _nwb(_instead("units/spike_times", h5py.Empty("f8"))),
        "complex times": _nwb(_instead("units/spike_times", np.array([1 + 2j, 2, 3]))),
        "records": _nwb(_instead("units/spike_times", np.zeros(3, [("a", "f8")]))),
        "an index of NaN": _nwb(_instead("units/spike_times_index", [np.nan])),
        "all pulses at one late time": _nwb(_instead("acquisition/sync_pulses/timestamps", [-(2**60)] * 4)),
        "an index that falls": _nwb(_instead("units/spike_times_index", [-2])),
    },
    "index of runs": {"a text that is no UTF-8": _index(b"\xff")},
    "script of a run": {"thousands of strings in a line": b"def run(rig):\n    " + b'{"a":' * DEEP + b"}" * DEEP},
    "table of afferents": {
        "many signs of equality": b"afferent,shape,force_gwt,file\na1,step" + b"{a=" * 30_000 + b",5,rates.csv\n",
        "many number signs": b"afferent,shape,force_gwt,file\na1,step:1,5,a.nwb" + b"#" * 60_000 + b"\n",
    },
    "readings of a row": {"readings at rest of 1e308": ROW.replace(",4.1", ",1e308").encode()},
    "journal": {
        "data nested too deeply": _event("[" * 5000),
        "data that is a list": _event("[]"),
        "a stream that is a number": _event("{}", "1.5"),
        "a time that is a text": _event("{}", t_s='"a"'),
        "a time and no kind": b'{"t_s": 1.0}\n',
        "a time that is NaN": _event("{}", t_s="NaN"),
    },
    "journal, exported": {
        "an event without a description of its stream": _event('{"indentor": "bar:3.0"}'),
        "a list instead of a text": _event('{"indentor": ["bar:3.0"]}'),
    },
    "journal, resumed": {"data that is a number": _event("1.5")},
    "provenance": {
        "no object": b"[]", "nothing in it": b"{}", "no JSON": b"{", "nested too deeply": b"[" * DEEP,
        "a model that is a text": b'{"protocol": "p.py", "parameters": {}, "virtual": true, "model": "a"}',
        "a command that is a number": b'{"protocol": "p.py", "parameters": {}, "virtual": true, "command": 1.5}',
        "parameters that are a list": b'{"protocol": "p.py", "parameters": [], "virtual": true}',
    },
    "checksums": {"bytes that are no text": b"\xff\n", "a line without a name": b"0" * 64 + b"\n", "no lines": b""},
    "course of a run": {
        "half of a surrogate pair": b'{"duration_s": 9.0, "passes": [["mou\\ud800nt", 1, 0, 0.0, ""]]}',
        "a duration of 400 digits": b'{"duration_s": ' + b"9" * 400 + b', "passes": []}',
        "marks that are a list": b'{"duration_s": 1.0, "passes": [["mount", 1, 0, 0.0, "", [1]]]}',
    },
    "memory of a bench": {"bytes that are no text": b"\xff"},
    "notes of owners": {
        "a key that is no hexadecimal number": b'{"pid": 1, "kind": "run", "virtual": true, "ports": ["a"], '
        b'"began_unix_s": 1.0, "address": "/nowhere", "key": "xyz"}',
    },
}  # fmt: skip

REPLIES_ONCE_FAILED = {
    "zaber": {"at rest, then at another place": Reply(SEALED, True, 2, b"@02 1 OK IDLE -- 1000")},
    "leadshine_tcp": {"a fault in the status of a move": Reply(PATCHED, False, 2, bytes.fromhex("0203020072d96ad1"))},
}
