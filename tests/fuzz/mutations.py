"""Hostile files from valid ones: mutations of bytes, lines, tables of values, and HDF5. A seed repeats a file."""

import datetime
import io
import json
import math
import random
import struct
import tomllib
import zlib
from collections.abc import Callable, Sequence
from functools import cache
from pickle import dumps, loads
from typing import Any

import h5py
import numpy as np

Mutation = Callable[[random.Random, Sequence[bytes]], bytes]

BOM = b"\xef\xbb\xbf"
CHUNKS = (
    b"\0", b"\0" * 64, b"\xff\xfe", BOM, b"\x1b[31m", b"\x9b2J", b"\r\n", b"\r", b"\n\n", b"\x0b", b"\x0c", b"\x1c",
    b"\xe2\x80\xa8", b"\xe2\x80\xae", b"\xc3\x28", b"\xf0\x9f\x92\xa9", b'"', b"'", b'"""', b"\\", b"#", b",", b";",
    b"\t", b"=", b"{", b"}", b"[[", b"]]", b"nan", b"inf", b"-inf", b"1e999", b"-1e308", b"-0.0", b"1" * 5000,
    b"0x10", b"1_000", b"9" * 25, b"A" * 20_000, b"NaN", b"Infinity", b"true", b"null", b"1979-05-27",
    b"\\ud800", "\u0663".encode(), "ß".encode("latin-1"),
)  # fmt: skip
CELLS = (
    "", " ", "nan", "inf", "-inf", "1e999", "1e308", "-1e308", "5e-324", "-0", "0", "-1", "1,5", "1_000", "0x10",
    "1e", "+", "\u0663", "\0", "\x1b[2J", "=1+1", '"', '"a', "'", "a", "\ufffd", "9" * 400, "x" * 10_000, "1 2",
    "true", "#", "1.5.2", "\u2028", "spike", "sync",
)  # fmt: skip
VALUES: tuple[Any, ...] = (
    0, -1, 1, 2**31, 2**63, -(2**63) - 1, 10**400, 0.0, -0.0, 1e308, -1e308, 5e-324, math.nan, math.inf, -math.inf,
    True, False, None, "", " ", "nan", "1", "\0", "\x1b[31m", "\u202e", "x" * 10_000, "bar:3.0", "profile:/", "{x}",
    "heightmap:,spacing_mm=1", "../..", [], {}, [[]], [None], {"": {}}, [0] * 500, [math.nan, math.inf], ["a", 1, {}],
    datetime.date(1, 1, 1), datetime.datetime(9999, 12, 31, 23, 59, 59), datetime.time(23, 59),
)  # fmt: skip
_DEPTHS = (20, 200, 2000, 20_000)
_LONGEST = 400_000


# --- bytes ---


def of_bytes(rng: random.Random, examples: Sequence[bytes]) -> bytes:
    """Return an example with one to four mutations of its bytes."""
    data = bytearray(rng.choice(examples))
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        rng.choice(_OF_BYTES)(rng, data, examples)
    return bytes(data[:_LONGEST])


def _place(rng: random.Random, data: bytearray) -> int:
    return rng.randrange(len(data) + 1)


def _slice(rng: random.Random, data: bytes | bytearray) -> bytes:
    begin = rng.randrange(len(data) + 1)
    return bytes(data[begin : begin + rng.choice((1, 2, 8, 64, 512))])


def _flip(rng: random.Random, data: bytearray, _: Sequence[bytes]) -> None:
    for _n in range(rng.choice((1, 1, 4, 16))):
        if data:
            data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)


def _truncate(rng: random.Random, data: bytearray, _: Sequence[bytes]) -> None:
    del data[_place(rng, data) :]


def _cut(rng: random.Random, data: bytearray, _: Sequence[bytes]) -> None:
    at = _place(rng, data)
    del data[at : at + rng.choice((1, 2, 8, 64, 512))]


def _repeat(rng: random.Random, data: bytearray, _: Sequence[bytes]) -> None:
    at = _place(rng, data)
    data[at:at] = _slice(rng, data) * rng.choice((1, 1, 2, 50))


def _insert(rng: random.Random, data: bytearray, _: Sequence[bytes]) -> None:
    at = _place(rng, data)
    data[at:at] = rng.choice(CHUNKS)


def _overwrite(rng: random.Random, data: bytearray, _: Sequence[bytes]) -> None:
    at = _place(rng, data)
    number = rng.choice((0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0xFFFFFFFF, 2**63 - 1, 2**64 - 1))
    packed = struct.pack("<Q", number)[: rng.choice((1, 2, 4, 8))]
    data[at : at + len(packed)] = packed if rng.random() < 0.7 else packed[::-1]


def _splice(rng: random.Random, data: bytearray, examples: Sequence[bytes]) -> None:
    other = rng.choice(examples)
    data[_place(rng, data) :] = other[rng.randrange(len(other) + 1) :]


def _nest(rng: random.Random, data: bytearray, _: Sequence[bytes]) -> None:
    opened, closed = rng.choice(((b"[", b"]"), (b'{"a":', b"}"), (b"{a=", b"}"), (b"(", b")"), (b"a.", b"a")))
    depth, at = rng.choice(_DEPTHS), _place(rng, data)
    data[at:at] = opened * depth + (closed * depth if rng.random() < 0.5 else b"")


def _encode(rng: random.Random, data: bytearray, _: Sequence[bytes]) -> None:
    text = data.decode("utf-8", "replace")
    data[:] = text.encode(rng.choice(("utf-16", "utf-32", "latin-1", "utf-8-sig", "utf-7", "cp437")), "replace")


def _line_ends(rng: random.Random, data: bytearray, _: Sequence[bytes]) -> None:
    data[:] = data.replace(b"\n", rng.choice((b"\r\n", b"\r", b"\n\n", b"", b"\xe2\x80\xa8", b" ")))


def _only(rng: random.Random, data: bytearray, _: Sequence[bytes]) -> None:
    data[:] = rng.choice((b"", b"\n", b"\0", BOM, b"#", b"[]", b"{}", b"null", b"0", b'""', b"\xff" * 100))


_OF_BYTES = (
    *(_flip, _flip, _truncate, _cut, _repeat, _insert, _insert, _overwrite, _overwrite, _splice, _nest),
    *(_encode, _line_ends, _only),
)


# --- tables of numbers, line by line ---


def of_table(rng: random.Random, examples: Sequence[bytes]) -> bytes:
    """Return a CSV example with mutated cells, rows and header, or mutated bytes."""
    if rng.random() < 0.25:
        return of_bytes(rng, examples)
    text = rng.choice(examples).decode("utf-8")
    sign = max(",;\t", key=text.count)
    rows = [line.split(sign) for line in text.splitlines()]
    others = [line.split(sign) for line in rng.choice(examples).decode("utf-8").splitlines()]
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        rng.choice(_OF_ROWS)(rng, rows, others)
        rows = rows or [[""]]
    if rng.random() < 0.1:
        sign = rng.choice((",", ";", "\t", " ", "|"))
    text = rng.choice(("\n", "\n", "\n", "\r\n")).join(sign.join(row) for row in rows)
    return (BOM if rng.random() < 0.05 else b"") + text.encode("utf-8", "replace")[:_LONGEST]


Rows = list[list[str]]


def _row(rng: random.Random, rows: Rows) -> list[str]:
    row = rng.choice(rows)
    return row if row else [""]


def _cell(rng: random.Random, rows: Rows, _: Rows) -> None:
    row = _row(rng, rows)
    row[rng.randrange(len(row))] = rng.choice(CELLS)


def _scaled(rng: random.Random, rows: Rows, _: Rows) -> None:
    column, factor = rng.randrange(len(_row(rng, rows))), rng.choice((-1, 0, 1e-9, 1e-3, 1e3, 1e12, 1e300, 1e-300))
    some = rows if rng.random() < 0.5 else [rng.choice(rows)]
    for row in some:
        if column < len(row):
            try:
                row[column] = repr(float(row[column]) * factor)
            except ValueError:
                continue


def _same_column(rng: random.Random, rows: Rows, _: Rows) -> None:
    column, cell = rng.randrange(len(_row(rng, rows))), rng.choice(CELLS)
    for row in rows[1:]:
        row[column : column + 1] = [cell]


def _swapped_columns(rng: random.Random, rows: Rows, _: Rows) -> None:
    a, b = (rng.randrange(len(_row(rng, rows))) for _n in range(2))
    for row in rows:
        if max(a, b) < len(row):
            row[a], row[b] = row[b], row[a]


def _fewer_cells(rng: random.Random, rows: Rows, _: Rows) -> None:
    row = rng.choice(rows)
    del row[rng.randrange(len(row) + 1) :]


def _more_cells(rng: random.Random, rows: Rows, _: Rows) -> None:
    rng.choice(rows).extend([rng.choice(CELLS)] * rng.choice((1, 2, 300)))


def _fewer_rows(rng: random.Random, rows: Rows, _: Rows) -> None:
    begin = rng.randrange(len(rows))
    del rows[begin : begin + rng.choice((1, 1, 3, 1000))]


def _more_rows(rng: random.Random, rows: Rows, others: Rows) -> None:
    at, some = rng.randrange(len(rows) + 1), rng.choice((rows, others))
    rows[at:at] = [list(rng.choice(some)) for _n in range(rng.choice((1, 1, 3, 300)))]


def _moved_row(rng: random.Random, rows: Rows, _: Rows) -> None:
    row = rows.pop(rng.randrange(len(rows)))
    rows.insert(rng.randrange(len(rows) + 1), row)


def _header(rng: random.Random, rows: Rows, others: Rows) -> None:
    names = [*rows[0], *(others[0] if others else []), "x_mm", "z_mm", "rate", "count", "time_s", "kind", "repeat"]
    if rows[0]:
        rows[0][rng.randrange(len(rows[0]))] = rng.choice(names)


def _comment(rng: random.Random, rows: Rows, _: Rows) -> None:
    rows.insert(rng.randrange(len(rows) + 1), [rng.choice(("# a", "#", "", " ", "\0", '"', "x" * 10_000))])


_OF_ROWS = (
    *(_cell, _cell, _cell, _scaled, _same_column, _swapped_columns, _fewer_cells, _more_cells, _fewer_rows),
    *(_more_rows, _moved_row, _header, _comment),
)


# --- trees of values: TOML, JSON, and JSON in lines ---


def of_toml(rng: random.Random, examples: Sequence[bytes]) -> bytes:
    """Return a TOML example with mutated keys and values, or mutated bytes."""
    if rng.random() < 0.25:
        return of_bytes(rng, examples)
    tree, other = (loads(_parsed(rng.choice(examples), toml=True)) for _ in range(2))
    tree = _mutated(rng, tree, other)
    tables = tree if isinstance(tree, dict) else {"a": tree}
    try:
        lines = [f"{_key(key)} = {_toml(value)}\n" for key, value in tables.items()]
    except RecursionError:
        return of_bytes(rng, examples)
    return "".join(lines).encode("utf-8", "replace")


@cache
def _parsed(example: bytes, *, toml: bool) -> bytes:
    """Return the pickled tree of an example, which is copied faster than parsed."""
    return dumps(tomllib.loads(example.decode("utf-8")) if toml else json.loads(example))


def of_json(rng: random.Random, examples: Sequence[bytes]) -> bytes:
    """Return a JSON example with mutated keys and values, or mutated bytes."""
    if rng.random() < 0.25:
        return of_bytes(rng, examples)
    tree, other = (loads(_parsed(rng.choice(examples), toml=False)) for _ in range(2))
    return _json(_mutated(rng, tree, other))


def of_json_lines(rng: random.Random, examples: Sequence[bytes]) -> bytes:
    """Return lines of JSON: some mutated, removed, repeated or moved; or mutated bytes."""
    if rng.random() < 0.2:
        return of_bytes(rng, examples)
    lines = rng.choice(examples).splitlines()
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        n = rng.randrange(len(lines)) if lines else 0
        match rng.randrange(8):
            case 0:
                del lines[n : n + rng.choice((1, 1, 5, 1000))]
            case 1:
                lines[n:n] = [rng.choice(lines)] * rng.choice((1, 2, 50)) if lines else [b"{}"]
            case 2 if lines:
                lines.insert(rng.randrange(len(lines)), lines.pop(n))
            case 3 if lines:
                lines[n] = rng.choice((b"{}", b"[]", b"1", b"", b"null", b'{"doc": "event"}', b"[" * 5000))
            case _ if lines and lines[n].startswith(b"{") and len(lines[n]) < 20_000:
                other = rng.choice(lines)
                try:
                    lines[n] = _json(_mutated(rng, json.loads(lines[n]), json.loads(other)))
                except (ValueError, RecursionError):
                    continue
    return b"\n".join(lines)[:_LONGEST] + rng.choice((b"\n", b"\n", b"\n", b""))


Path = tuple[Any, ...]


def _paths(tree: Any, here: Path = (), most: int = 400) -> list[Path]:
    """Return the places of values in a tree, at most so many."""
    found: list[Path] = []
    pairs = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    for key, value in pairs:
        if len(found) >= most:
            break
        found += [(*here, key), *_paths(value, (*here, key), most // 4)]
    return found


def _at(tree: Any, path: Path) -> Any:
    for key in path:
        tree = tree[key]
    return tree


def _mutated(rng: random.Random, tree: Any, other: Any) -> Any:
    for _ in range(rng.choice((1, 1, 1, 1, 2, 4))):
        paths = _paths(tree)
        if not paths:
            return rng.choice(VALUES)
        *above, key = rng.choice(paths)
        inside = _at(tree, tuple(above))
        value = inside[key]
        match rng.randrange(12):
            case 0:
                del inside[key]
            case 1 if isinstance(inside, dict):
                names = [key + "x", key.upper(), "", "\0", "a.b", "x" * 10_000]
                inside[rng.choice(names)] = inside.pop(key)
            case 2:
                inside[key] = [value]
            case 3:
                inside[key] = {"a": value}
            case 4 if isinstance(value, int | float) and not isinstance(value, bool):
                factor = rng.choice((-1, 0, 0.5, 1e-9, 1e3, 10**30, 1e300))
                inside[key] = value * (int(factor) if isinstance(value, int) and abs(value) > 10**300 else factor)
            case 5:
                inside[key] = _at(other, rng.choice(_paths(other) or [()]))
            case 6 if isinstance(value, list) and value:
                inside[key] = rng.choice((value * 2, value[:-1], value * 50, value[::-1], [*value, None]))
            case 7 if isinstance(value, str):
                inside[key] = rng.choice(
                    (value + "x", value[:-1], value.upper(), f" {value}", f"{value}\n", [*value])
                )
            case 8 if rng.random() < 0.1:
                inside[key] = _nested(rng)
            case _:
                inside[key] = rng.choice(VALUES)
    return tree


def _nested(rng: random.Random) -> Any:
    """Return a list or table nested deeper than any that is of use."""
    value: Any = 1
    for _ in range(rng.choice(_DEPTHS[:2])):
        value = [value] if rng.random() < 0.5 else {"a": value}
    return value


def _json(tree: Any) -> bytes:
    try:
        return json.dumps(tree, default=str).encode("ascii")
    except (ValueError, RecursionError):  # a number of more digits than Python prints
        return b"1" * 5000


def _key(key: str) -> str:
    return json.dumps(key)


def _toml(value: Any) -> str:
    """Return a value in one line of TOML; null, which TOML lacks, is text."""
    match value:
        case bool():
            return "true" if value else "false"
        case int() if abs(value) > 10**300:
            return "9" * 400
        case float() if not math.isfinite(value):
            return "nan" if math.isnan(value) else "inf" if value > 0 else "-inf"
        case dict():
            return "{" + ", ".join(f"{_key(key)} = {_toml(one)}" for key, one in value.items()) + "}"
        case list():
            return "[" + ", ".join(map(_toml, value)) + "]"
        case datetime.date() | datetime.time():
            return value.isoformat()
        case str():
            return json.dumps(value).replace("\\u202e", "\u202e").replace("\x7f", "\\u007f")
        case None:
            return '"null"'
    return repr(value)


# --- NumPy files and pictures ---


def of_npy(rng: random.Random, examples: Sequence[bytes]) -> bytes:
    """Return a NumPy file of another type, shape, order or content, or mutated bytes."""
    if rng.random() < 0.4:
        return of_bytes(rng, examples)
    array = np.load(io.BytesIO(rng.choice(examples)))
    if rng.random() < 0.5:
        array = array.astype(rng.choice(("i1", "u8", ">f4", "f2", "c16", "?", "S3", "U2", "M8[s]", "g")))
    if rng.random() < 0.4:
        shape = rng.choice(((0,), (0, 4), (4, 0), (1, 1), (1,), (4, 4, 1), (2, 3), (3, 1000), ()))
        array = np.resize(array, shape)
    if array.dtype.kind == "f" and array.size and rng.random() < 0.6:
        array = array.copy()
        array.flat[rng.randrange(array.size)] = rng.choice((math.nan, math.inf, 1e300, -1e300, 1e30, 5e-324))
    if array.ndim == 2 and rng.random() < 0.3:
        array = np.asfortranarray(array)
    stream = io.BytesIO()
    np.save(stream, array)
    data = stream.getvalue()
    if rng.random() < 0.3:
        header = rng.choice(
            (b"(1000000000, 1000000000)", b"(-1, 3)", b"(3,", b"((((", b"(True, 2)", b"'a'", b"(9" * 999)
        )
        begin = data.find(b"(")
        data = data[:begin] + header + data[data.find(b")") + 1 :]
    return data


def of_png(rng: random.Random, examples: Sequence[bytes]) -> bytes:
    """Return a picture with mutated chunks, whose checksums are right, or mutated bytes."""
    if rng.random() < 0.4:
        return of_bytes(rng, examples)
    data = rng.choice(examples)
    chunks, at = [], 8
    while at + 8 <= len(data):
        (length,) = struct.unpack(">I", data[at : at + 4])
        chunks.append((data[at + 4 : at + 8], bytearray(data[at + 8 : at + 8 + length])))
        at += 12 + length
    for _ in range(rng.choice((1, 1, 2))):
        n = rng.randrange(len(chunks))
        kind, body = chunks[n]
        match rng.randrange(6):
            case 0:
                del chunks[n]
                chunks = chunks or [(b"IEND", bytearray())]
            case 1:
                chunks.insert(rng.randrange(len(chunks) + 1), (kind, bytearray(body)))
            case 2:
                named = rng.choice((b"PLTE", b"tRNS", b"zTXt", b"iTXt", b"gAMA", b"pHYs", b"eXIf", b"iCCP", b"acTL"))
                chunks.insert(n, (named, bytearray(rng.randbytes(rng.choice((0, 1, 9, 300))))))
            case 3 if kind == b"IDAT":
                raw = rng.choice((b"", b"\0" * 10, b"\5" * 200, rng.randbytes(500)))
                chunks[n] = (kind, bytearray(zlib.compress(raw)))
            case _:
                _overwrite(rng, body, ())
    parts = (struct.pack(">I", len(b)) + k + bytes(b) + struct.pack(">I", zlib.crc32(k + b)) for k, b in chunks)
    return data[:8] + b"".join(parts)


# --- HDF5 ---


def of_hdf5(rng: random.Random, examples: Sequence[bytes]) -> bytes:
    """Return an HDF5 file with datasets of other types and shapes, links and attributes, or mutated bytes."""
    if rng.random() < 0.4:
        return of_bytes(rng, examples)
    stream = io.BytesIO(rng.choice(examples))
    with h5py.File(stream, "r+") as file:
        for _ in range(rng.choice((1, 1, 2))):
            names: list[str] = []
            file.visit(names.append)
            if names:
                _mutate_object(rng, file, rng.choice(names))
    return stream.getvalue()


def _mutate_object(rng: random.Random, file: h5py.File, name: str) -> None:
    one = file[name]
    if rng.random() < 0.2 and len(one.attrs):
        one.attrs[rng.choice(list(one.attrs))] = rng.choice((1, "x", b"\xff", math.nan, [1, 2], h5py.Empty("f8")))
        return
    old = one[()] if isinstance(one, h5py.Dataset) else None
    del file[name]
    match rng.randrange(7):
        case 0:
            return
        case 1:
            file.create_group(name)
        case 2:
            file[name] = rng.choice(
                (
                    h5py.SoftLink("/nowhere"),
                    h5py.SoftLink(f"/{name}"),
                    h5py.ExternalLink("nowhere.h5", "/"),
                    h5py.ExternalLink("/dev/zero", "/"),
                    h5py.SoftLink("/"),
                )
            )
        case 3 | 4:
            file[name] = _other_values(rng, old)
        case 5:
            kind = rng.choice(("i1", "u8", "f2", "c16", "S3", "?", [("a", "f8"), ("b", "i4")], "V5"))
            with np.errstate(all="ignore"):
                file.create_dataset(name, rng.choice(((), (0,), (3,), (2, 3), (1, 1, 1))), kind)
        case 6:
            kind = rng.choice((h5py.string_dtype(), h5py.vlen_dtype("f8"), h5py.ref_dtype, h5py.enum_dtype({"a": 1})))
            file.create_dataset(name, rng.choice(((), (2,), (2, 2))), kind)


def _other_values(rng: random.Random, old: Any) -> Any:
    if not isinstance(old, np.ndarray) or old.dtype.kind not in "iuf" or not old.size:
        return rng.choice((h5py.Empty("f8"), 0, "text", [b"\xff"], [1.5, math.nan], [-1], [2**62]))
    new = old.astype(rng.choice(("f8", "i8", "f8")))
    value = rng.choice(
        (-1, 0, 2**40, -(2**60)) if new.dtype.kind == "i" else (math.nan, math.inf, -1e300, 1e308, -1.0)
    )
    match rng.randrange(5):
        case 0:
            new.flat[rng.randrange(new.size)] = value
        case 1:
            new[...] = value
        case 2:
            new = new[::-1].copy()
        case 3:
            new = new.reshape(1, -1) if rng.random() < 0.5 else np.tile(new, 3)
        case 4:
            new = new[: rng.randrange(new.size)]
    return new
