"""Vectors and texts in MATLAB files of level 5 (`save -v6` and `-v7`).

They are read here, since a damaged file may end scipy's reader and this program.

Format: MathWorks, "MAT-File Format", chapter 1. An element has a tag (its type and its number of bytes) and is padded
to 8 bytes; a small one has its bytes in the tag. A variable is a matrix element, which may be compressed as a whole.
"""

import math
import struct
import zlib
from collections.abc import Iterator
from itertools import islice
from typing import NamedTuple, NoReturn

import numpy as np
from numpy.typing import NDArray

_HEADER, _TAG = 128, 8
_MATRIX, _COMPRESSED = 14, 15
_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_ENCODINGS = {1: "latin-1", 2: "latin-1", 4: "utf-16", 16: "utf-8", 17: "utf-16", 18: "utf-32"}
_CELL, _CHAR, _OPAQUE = 1, 4, 17
_CLASSES = {1: "cell", 2: "struct", 3: "object", 4: "char", 5: "sparse", 16: "function", 17: "object"}
_COMPLEX, _LOGICAL = 0x0800, 0x0200


MATLAB_DAMAGE = (ValueError, struct.error)
"""Errors of a damaged file."""


class MatlabVariable(NamedTuple):
    """A variable: its name, shape and kind (such as "struct", "" for numbers), and its numbers or texts."""

    name: str
    shape: tuple[int, ...]
    kind: str
    values: NDArray[np.float64] | None = None
    logical: bool = False
    texts: tuple[str, ...] | None = None
    """Of a row of letters, of several rows of them, or of cells with a text or a number each."""

    @property
    def vector(self) -> NDArray[np.float64] | None:
        """The numbers of a vector or scalar, None for others."""
        return self.values if self._is_vector else None

    @property
    def length(self) -> int | None:
        """The number of rows of a variable that may be a column of a table; None for others."""
        if self.texts is not None:
            return len(self.texts) if self.kind == "char" or self._is_vector else None
        return None if self.vector is None or self.logical else len(self.vector)

    def column(self) -> list[str]:
        """Return the texts, or the numbers as texts, of a variable that may be a column."""
        if self.texts is not None:
            return list(self.texts)
        assert self.values is not None
        return [f"{value:.17g}" for value in self.values]

    def row_problem(self, rows: int) -> str:
        """What a row of as many letters as the table has rows is, with its article; "" for others."""
        if self.kind != "char" or rows == 1 or self.shape != (1, rows):
            return ""
        return f"a row of {rows} letters, as many as there are rows: one name, or a letter for each"

    @property
    def _is_vector(self) -> bool:
        return len(self.shape) - self.shape.count(1) <= 1 and math.prod(self.shape) > 0

    @property
    def size(self) -> str:
        """The length, the shape, or the kind, in words."""
        if self.length is not None:
            return f"char, {self.length}" if self.kind == "char" else str(self.length)
        shape = " × ".join(map(str, self.shape))
        return f"{self.kind}, {shape}" if self.kind in ("complex", "cell") else self.kind or shape

    @property
    def problem(self) -> str:
        """What a variable is that has no column, with its article."""
        if self.kind in _PROBLEMS:
            return _PROBLEMS[self.kind]
        if self.kind:
            return f"of the class {self.kind}"
        return "a logical vector" if self.vector is not None else f"an array of {' × '.join(map(str, self.shape))}"


_PROBLEMS = {
    "cell": "a cell array of cells, of arrays, or of several rows and columns",
    "struct": "a struct",
    "sparse": "a sparse matrix",
    "complex": "a complex vector",
}


def matlab_variables(content: bytes, most_bytes: int) -> list[MatlabVariable]:
    """Return the variables of a file.

    Raises
    ------
    ValueError
        If the file is damaged, or unpacks to more than `most_bytes`.
    """
    order = {b"IM": "<", b"MI": ">"}.get(content[_HEADER - 2 : _HEADER])
    if order is None:
        raise ValueError("its header has no mark of the byte order")
    found = []
    for kind, data in _elements(content[_HEADER:], order):
        if kind == _COMPRESSED:
            found += [_variable(one, order) for inner, one in _elements(_unpacked(data, most_bytes), order)
                      if inner == _MATRIX]  # fmt: skip
        elif kind == _MATRIX:
            found.append(_variable(data, order))
    return [one for one in found if one.name]  # the data of objects follow in a variable without a name


def _unpacked(data: bytes, most_bytes: int) -> bytes:
    unpacking = zlib.decompressobj()
    try:
        found = unpacking.decompress(data, most_bytes)
    except zlib.error as error:
        raise ValueError(str(error)) from None
    if unpacking.unconsumed_tail:
        raise ValueError(f"a variable is larger than {most_bytes / 1e6:g} MB")
    return found


def _elements(data: bytes, order: str) -> Iterator[tuple[int, bytes]]:
    """Yield the type and the bytes of each element. Raises ValueError."""
    at = 0
    while at + _TAG <= len(data):
        kind, size = struct.unpack_from(f"{order}II", data, at)
        if kind >> 16:  # a small element
            kind, size, begin, step = kind & 0xFFFF, kind >> 16, at + _TAG // 2, _TAG
        else:
            begin, step = at + _TAG, _TAG + (size if kind == _COMPRESSED else -(-size // _TAG) * _TAG)
        if begin + size > len(data):
            raise ValueError("it ends before its content does")
        yield kind, data[begin : begin + size]
        at += step


def _variable(data: bytes, order: str, *, in_cell: bool = False) -> MatlabVariable:
    parts = list(islice(_elements(data, order), _MOST_PARTS + 1))
    if len(parts) > _MOST_PARTS:
        raise ValueError(f"a cell array has more than {_MOST_PARTS} cells")
    (_, flags), (_, sizes), (_, name), *rest = parts if len(parts) >= _PARTS else _damaged()
    flag = struct.unpack_from(f"{order}I", flags)[0] if len(flags) >= _TAG else _damaged()
    code = flag & 0xFF
    if code == _OPAQUE:  # its name, the system of its class, and the name of that
        return MatlabVariable(_text(sizes), (), _text(rest[0][1]) if rest else _CLASSES[code])
    shape = tuple(int(one) for one in np.frombuffer(sizes[: len(sizes) // 4 * 4], f"{order}i4"))
    if any(one < 0 for one in shape):
        _damaged()
    kind = "complex" if flag & _COMPLEX else _CLASSES.get(code, "")
    made = MatlabVariable(_text(name), shape, kind)
    if kind == "char":
        return made._replace(texts=_rows_of_letters(shape, *rest[0], order) if rest else ("",))
    if kind == "cell" and not in_cell:
        return made._replace(texts=_texts_of_cells([one for inner, one in rest if inner == _MATRIX], order))
    if kind:
        return made
    number, numbers = rest[0] if rest else _damaged()
    if number not in _TYPES:
        _damaged()
    values = np.frombuffer(numbers, f"{order}{_TYPES[number]}").astype(float) if numbers else np.empty(0)
    if len(values) != math.prod(shape):
        _damaged()
    return made._replace(values=values, logical=bool(flag & _LOGICAL))


def _text(name: bytes) -> str:
    return name.decode("utf-8", "replace")


def _rows_of_letters(shape: tuple[int, ...], kind: int, data: bytes, order: str) -> tuple[str, ...] | None:
    """Return the rows of a matrix of letters, which are stored column by column, without spaces at their ends."""
    encoding = _ENCODINGS.get(kind) or _damaged()
    wide = encoding.startswith(("utf-16", "utf-32"))
    text = data.decode(encoding + {"<": "-le", ">": "-be"}[order] * wide, "replace")
    if len(shape) != 2 or (shape[0] > 1 and len(text) != math.prod(shape)):
        return None
    return tuple(text[row :: shape[0]].strip() for row in range(shape[0])) or ("",)


def _texts_of_cells(cells: list[bytes], order: str) -> tuple[str, ...] | None:
    """Return the text or number in each cell, "" for an empty one; None if a cell has something else."""
    found = list[str]()
    for data in cells:
        one = _variable(data, order, in_cell=True) if data else MatlabVariable("", (0, 0), "char", texts=("",))
        empty = one.values is not None and not len(one.values)
        if not empty and one.length != 1:
            return None
        found += [""] if empty else one.column()
    return tuple(found)


_PARTS, _MOST_PARTS = 3, 2_000_000


def _damaged() -> NoReturn:
    raise ValueError("a variable is not complete")
