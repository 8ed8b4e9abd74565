"""Reading of files that somebody else may have made: regular files only, and no more than a limit."""

import errno
import hashlib
import io
import json
import os
import re
import stat
import sys
import tomllib
from pathlib import Path
from typing import Any, BinaryIO

MOST_BYTES = 256_000_000
"""Largest file that is read as a whole, such as a journal."""

MOST_TABLE_BYTES = 32_000_000

MOST_TOML_BYTES = 4_000_000

MOST_LINES = 1_000_100
"""A million rows, their header and comments."""

_OPEN = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)
_SPECIAL = {
    stat.S_IFIFO: "a pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}


def open_file(path: str | Path, *, buffering: int = -1) -> BinaryIO:
    """Open a regular file for reading.

    A pipe would block, and opening a device may act on it, so what the path names is examined first. Raises OSError
    if the file cannot be read, or is a pipe, a socket, a device or a folder.
    """
    try:
        _refuse_special(path, os.stat(path))
        number = os.open(path, os.O_RDONLY | _OPEN)
    except ValueError:  # a NUL, or half of a surrogate pair
        raise OSError(errno.EINVAL, "not the name of a file", str(path)) from None
    try:
        _refuse_special(path, os.fstat(number))  # it may have been replaced in between
        return os.fdopen(number, "rb", buffering)
    except OSError:
        os.close(number)
        raise


def _refuse_special(path: str | Path, found: os.stat_result) -> None:
    kind = stat.S_IFMT(found.st_mode)
    if kind == stat.S_IFDIR:
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if kind != stat.S_IFREG:
        what = _SPECIAL.get(kind, "something else")
        raise OSError(errno.EINVAL, f"{what} instead of a regular file", str(path))


def read_bytes(path: str | Path, most: int = MOST_BYTES) -> bytes:
    """Return the content of a regular file of at most so many bytes. Raises OSError, also if it grows beyond them."""
    with open_file(path, buffering=0) as file:
        size, parts, left = os.fstat(file.fileno()).st_size, [], most + 1
        while size <= most and left > 0 and (part := file.read(min(left, max(size + 1, 1 << 16)))):
            parts.append(part)
            left -= len(part)
    if size > most or left <= 0:
        raise OSError(errno.EFBIG, f"larger than {most / 1e6:g} MB, which is the limit", str(path))
    return b"".join(parts)


def text_of(content: bytes, *, encoding: str = "utf-8", errors: str = "strict") -> io.TextIOWrapper:
    """Return the lines of a file's content. Reading raises UnicodeDecodeError."""
    return io.TextIOWrapper(io.BytesIO(content), encoding=encoding, errors=errors)


def lines_of(path: str | Path, *, most: int, lines: int = MOST_LINES) -> io.TextIOWrapper:
    """Return the lines of a table, with or without a byte-order mark.

    Raises OSError as `read_bytes`, and for too many lines.
    """
    content = read_bytes(path, most)
    if max(content.count(b"\n"), content.count(b"\r")) > lines:
        raise OSError(errno.EFBIG, f"more than {lines} lines, which is the limit", str(path))
    return text_of(content, encoding="utf-8-sig")


def read_text(path: str | Path, *, encoding: str = "utf-8", errors: str = "strict", most: int = MOST_BYTES) -> str:
    """Return the text of a regular file. Raises OSError as `read_bytes`, and UnicodeDecodeError."""
    return text_of(read_bytes(path, most), encoding=encoding, errors=errors).read()


def sha256_of(path: str | Path) -> str:
    """Return the SHA-256 of a regular file of any size. Raises OSError."""
    digest = hashlib.sha256()
    with open_file(path) as file:
        while part := file.read(1 << 20):
            digest.update(part)
    return digest.hexdigest()


def json_of(text: str | bytes) -> Any:
    """Return the value of a JSON text. Raises ValueError, also if it is nested too deeply."""
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError(_TOO_DEEP) from None


def toml_of(text: str) -> dict[str, Any]:
    """Return the tables of a TOML text. Raises TOMLDecodeError, also for nesting and numbers beyond the limits."""
    if _LONG_KEY.search(text):  # its parts cost the parser quadratic time and memory
        raise tomllib.TOMLDecodeError(_TOO_DEEP)
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise tomllib.TOMLDecodeError(_TOO_DEEP) from None
    except tomllib.TOMLDecodeError:
        raise
    except ValueError:  # of Python, for an integer
        most = sys.get_int_max_str_digits()
        raise tomllib.TOMLDecodeError(f"a number has more than {most} digits") from None


_LONG_KEY = re.compile(r"""(?:\.[ \t]*+(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+){100}""")
_TOO_DEEP = "nested too deeply"
