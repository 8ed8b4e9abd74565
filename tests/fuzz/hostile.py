"""Hostile inputs from valid examples, as one strategy: edits of bytes, and of the words between separators."""

import re
from collections.abc import Callable, Sequence

from hypothesis import strategies as st

Draw = st.DrawFn
Edit = Callable[[Draw, bytes, Sequence[bytes]], bytes]

_LONGEST = 400_000
_WORD = re.compile(rb"[^\s,;:={}\[\]()\"']+")
_PIECES = (
    *(b"\0", b"\0" * 64, b"\xff\xfe", b"\xef\xbb\xbf", b"\x1b[31m", b"\r\n", b"\r", b"\n\n", b"\x0b", b"\x1c"),
    *(b"\xe2\x80\xa8", b"\xe2\x80\xae", b"\xc3\x28", b'"', b"'", b'"""', b"\\", b"#", b",", b";", b"\t", b"=", b"{"),
    *(b"}", b"[[", b"]]", b"\\ud800", b"[" * 20_000, b'{"a":' * 2000, b"{a=" * 2000, b"a." * 20_000, b"A" * 20_000),
)
_WORDS = (
    *(b"", b"nan", b"inf", b"-inf", b"1e999", b"1e308", b"-1e308", b"5e-324", b"-0", b"0", b"-1", b"1,5", b"1_000"),
    *(
        b"0x10",
        b"1e",
        b"9" * 25,
        b"1" * 5000,
        b"9223372036854775808",
        b"true",
        b"null",
        b"[]",
        b"{}",
        b'""',
        b"[null]",
    ),
    *("\u0663".encode(), "ß".encode("latin-1"), b"1979-05-27", b"=1+1", b"../..", b"bar:3.0", b"spike", b"sync"),
    *(b"x_mm", b"z_mm", b"rate", b"count", b"time_s", b"repeat"),
)
_NUMBERS = (0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0xFFFFFFFF, 2**63 - 1, 2**64 - 1)


def _range(draw: Draw, length: int, most: int) -> tuple[int, int]:
    begin = draw(st.integers(0, length))
    return begin, begin + draw(st.integers(0, most))


def _cut(draw: Draw, data: bytes, _: Sequence[bytes]) -> bytes:
    begin, end = _range(draw, len(data), 512)
    return data[:begin] + data[end:]


def _truncate(draw: Draw, data: bytes, _: Sequence[bytes]) -> bytes:
    return data[: draw(st.integers(0, len(data)))]


def _repeat(draw: Draw, data: bytes, _: Sequence[bytes]) -> bytes:
    begin, end = _range(draw, len(data), 64)
    return data[:end] + data[begin:end] * draw(st.sampled_from((1, 2, 50))) + data[end:]


def _flip(draw: Draw, data: bytes, _: Sequence[bytes]) -> bytes:
    at = draw(st.integers(0, len(data)))
    return data[:at] + bytes(byte ^ 1 << draw(st.integers(0, 7)) for byte in data[at : at + 1]) + data[at + 1 :]


def _insert(draw: Draw, data: bytes, _: Sequence[bytes]) -> bytes:
    at = draw(st.integers(0, len(data)))
    return data[:at] + draw(st.sampled_from(_PIECES) | st.binary(max_size=8)) + data[at:]


def _overwrite(draw: Draw, data: bytes, _: Sequence[bytes]) -> bytes:
    at, size = draw(st.integers(0, len(data))), draw(st.sampled_from((1, 2, 4, 8)))
    number = draw(st.sampled_from(_NUMBERS)) % 256**size
    return data[:at] + number.to_bytes(size, draw(st.sampled_from(("little", "big")))) + data[at + size :]


def _splice(draw: Draw, data: bytes, examples: Sequence[bytes]) -> bytes:
    other = draw(st.sampled_from(examples))
    return data[: draw(st.integers(0, len(data)))] + other[draw(st.integers(0, len(other))) :]


def _encode(draw: Draw, data: bytes, _: Sequence[bytes]) -> bytes:
    coding = draw(st.sampled_from(("utf-16", "utf-32", "latin-1", "utf-8-sig", "utf-7", "cp437")))
    return data.decode("utf-8", "replace").encode(coding, "replace")


def _line_ends(draw: Draw, data: bytes, _: Sequence[bytes]) -> bytes:
    return data.replace(b"\n", draw(st.sampled_from((b"\r\n", b"\r", b"\n\n", b"", b"\xe2\x80\xa8", b" "))))


def _word(draw: Draw, data: bytes, _: Sequence[bytes]) -> bytes:
    """Put another word, or one of the same file, in the place of a word."""
    found = [match.span() for match in _WORD.finditer(data)]
    if not found:
        return data
    (begin, end), (other, its_end) = draw(st.sampled_from(found)), draw(st.sampled_from(found))
    return data[:begin] + draw(st.sampled_from(_WORDS) | st.just(data[other:its_end])) + data[end:]


def _lines(draw: Draw, data: bytes, _: Sequence[bytes]) -> bytes:
    """Remove, repeat or move lines."""
    lines = data.splitlines(keepends=True)
    begin, end = _range(draw, len(lines), 5)
    some = lines[begin:end]
    if draw(st.booleans()):
        del lines[begin:end]
    at = draw(st.integers(0, len(lines)))
    lines[at:at] = some * draw(st.sampled_from((0, 1, 50)))
    return b"".join(lines)


def _separators(draw: Draw, data: bytes, _: Sequence[bytes]) -> bytes:
    old, new = (draw(st.sampled_from((b",", b";", b"\t", b" ", b"|", b"=", b":"))) for _ in range(2))
    return data.replace(old, new)


_EDITS: tuple[Edit, ...] = (
    *(_word, _word, _word, _lines, _lines, _separators),
    *(_cut, _truncate, _repeat, _flip, _insert, _overwrite, _splice, _encode, _line_ends),
)


@st.composite
def hostile(draw: Draw, examples: Sequence[bytes]) -> bytes:
    """Draw an example with one to four edits."""
    data = draw(st.sampled_from(examples))
    for edit in draw(st.lists(st.sampled_from(_EDITS), min_size=1, max_size=4)):
        data = edit(draw, data, examples)[:_LONGEST]
    return data
