"""Vectors in MATLAB files of level 5 (`save -v6` and `-v7`), read here: a damaged file may end scipy's reader and us.

Format: MathWorks, "MAT-File Format", chapter 1. An element has a tag (its type and its number of bytes) and is padded
to 8 bytes; a small one has its bytes in the tag. A variable is a matrix element, which may be compressed as a whole.
"""

import math
import struct
import zlib
from collections.abc import Iterator
from typing import NamedTuple, NoReturn

import numpy as np
from numpy.typing import NDArray

_HEADER, _TAG = 128, 8
_MATRIX, _COMPRESSED = 14, 15
_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_CLASSES = {1: "cell", 2: "struct", 3: "object", 4: "char", 5: "sparse", 16: "function", 17: "object"}
_COMPLEX, _LOGICAL = 0x0800, 0x0200


class MatlabVariable(NamedTuple):
    """A variable: its name and shape, and its numbers, or the kind of one that has none, such as "struct"."""

    name: str
    shape: tuple[int, ...]
    kind: str
    values: NDArray[np.float64] | None
    logical: bool = False

    @property
    def vector(self) -> NDArray[np.float64] | None:
        """The numbers of a vector or scalar, None for others."""
        is_vector = len(self.shape) - self.shape.count(1) <= 1 and math.prod(self.shape) > 0
        return self.values if is_vector else None

    @property
    def size(self) -> str:
        """The length, the shape, or the kind, in words."""
        if self.values is None:
            return f"{self.kind}, {' × '.join(map(str, self.shape))}" if self.kind == "complex" else self.kind
        return str(len(self.values)) if self.vector is not None else " × ".join(map(str, self.shape))


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
    return found


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


def _variable(data: bytes, order: str) -> MatlabVariable:
    parts = list(_elements(data, order))
    (_, flags), (_, sizes), (_, name), *rest = parts if len(parts) >= _PARTS else _damaged()
    flag = struct.unpack_from(f"{order}I", flags)[0] if len(flags) >= _TAG else _damaged()
    shape = tuple(int(one) for one in np.frombuffer(sizes[: len(sizes) // 4 * 4], f"{order}i4"))
    kind = "complex" if flag & _COMPLEX else _CLASSES.get(flag & 0xFF, "")
    text = name.decode("utf-8", "replace")
    if kind:
        return MatlabVariable(text, shape, kind, None)
    code, numbers = rest[0] if rest else _damaged()
    if code not in _TYPES:
        _damaged()
    values = np.frombuffer(numbers, f"{order}{_TYPES[code]}").astype(float) if numbers else np.empty(0)
    if any(one < 0 for one in shape) or len(values) != math.prod(shape):
        _damaged()
    return MatlabVariable(text, shape, "", values, bool(flag & _LOGICAL))


_PARTS = 3


def _damaged() -> NoReturn:
    raise ValueError("a variable is not complete")
