"""Folder of one run: hashed copies of its inputs, beside what it recorded."""

import contextlib
import csv
import errno
import io
import json
import os
import secrets
import shutil
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import filelock

from rig.clock import WallClock
from rig.errors import BadInputError, RigError
from rig_shared.outputs import Name, Output
from rig_shared.user_files import read_bytes, read_text, sha256_of

_SUMS, _LOCK = "SHA256SUMS", ".lock"
_DIGITS = 64
_READ_S, _AGAIN_S = 0.5, 0.005
_NOT_ALLOWED = (errno.EACCES, errno.EPERM, errno.EROFS)
_COPIES = ("protocol.py", "config.toml", "provenance.json")
PLAN = "plan.jsonl"
"""Name of the steps that a run planned when it began."""
SHAPE_COPY = "shape_"
"""Prefix of the copies of shape files."""


class FileSizeJson(Output):
    """A file."""

    name: Name
    bytes: int


class FolderBusyError(RigError):
    """Error of a run that another process writes to."""

    default_code = "folder_busy"


class UnwritableError(RigError, OSError):
    """Error of a file that cannot be written; the old file is unchanged."""

    default_code = "unwritable"

    @classmethod
    def of(cls, path: Path, error: OSError) -> "UnwritableError":
        """Return the error for a failed write."""
        reason = error.strerror or str(error)
        free = f", {free_space(path)}" if allowed(error) else ""
        what = f"cannot be written: {reason}{free}"
        made = cls(f"{path}: {what}")
        made.errno, made.filename, made.strerror = error.errno, str(path), what
        return made

    def __str__(self) -> str:
        return str(self.args[0])  # OSError would put its number first.

    def __reduce__(self) -> tuple[Any, ...]:
        again, whose, state = super().__reduce__()  # Without what OSError stores outside of __dict__.
        stored = ("args", "errno", "strerror", "filename")
        return again, whose, {**state, **{name: getattr(self, name) for name in stored}}


@dataclass(frozen=True)
class RunFolder:
    """Paths of the files in a run folder."""

    path: Path

    @property
    def events(self) -> Path:
        """Journal, the primary record of the run."""
        return self.path / "events.jsonl"

    @property
    def bytes_log(self) -> Path:
        """Log of all bytes sent and received."""
        return self.path / "bytes.jsonl"

    @property
    def data(self) -> Path:
        """Exported data, as HDF5."""
        return self.path / "data.h5"

    @property
    def report(self) -> Path:
        """HTML report."""
        return self.path / "report.html"

    @property
    def config(self) -> Path:
        """Configuration of the run."""
        return self.path / "config.toml"

    @property
    def provenance(self) -> Path:
        """Versions, command and parameters."""
        return self.path / "provenance.json"

    @property
    def files(self) -> set[str]:
        """Names of all files except the checksums."""
        return {p.name for p in self.path.iterdir() if p.is_file() and p.name not in (_SUMS, _LOCK)}

    def write_checksums(self, *, new: bool = False) -> None:
        """Write SHA256SUMS for every file of the folder, as `sha256sum -c` reads it.

        The copied inputs keep the checksums that they had when the run began, or none: only a `new` folder is
        known to have those of the run.
        """
        known = self._known_sums() if (self.path / _SUMS).exists() else {}
        inputs = self._inputs({*known, *self.files}) if not new else ()
        kept = {name: known[name] for name in inputs if name in known}
        self._write_sums({name: _digest(self.path / name) for name in self.files - {*inputs}} | kept)

    def add_checksums(self, made: set[str]) -> None:
        """Update SHA256SUMS for new files, and leave the other lines unchanged."""
        known = self._known_sums() if (self.path / _SUMS).exists() else {}
        new = made | (self.files - set(known) - {*self._inputs(self.files)})
        if new:
            self._write_sums(known | {name: _digest(self.path / name) for name in new})

    def _write_sums(self, sums: Mapping[str, str]) -> None:
        replace_text(self.path / _SUMS, "".join(f"{sums[name]}  {name}\n" for name in sorted(sums)))

    def _known_sums(self) -> dict[str, str]:
        """Return the digests by file name, without lines that are damaged."""
        lines = read_text(self.path / _SUMS, errors="replace").splitlines()
        parts = (line.partition("  ") for line in lines)
        return {name: digest for digest, _, name in parts if len(digest) == _DIGITS and name}

    def changed(self) -> list[str]:
        """Return the copied inputs that have changed since the run began. Raises OSError."""
        known = self._known_sums()
        return [name for name in self._inputs(known) if known.get(name) != _digest(self.path / name)]

    @property
    def warnings(self) -> list[str]:
        """Sentences on the copied inputs that have changed since the run began, and on those that may have."""
        try:
            known = self._known_sums()
        except FileNotFoundError:
            known = {}
        except OSError:
            return []
        there = [name for name in self._inputs({*known, *self.files}) if (self.path / name).is_file()]
        try:
            changed = [name for name in there if name in known and known[name] != _digest(self.path / name)]
        except OSError:
            return []
        missing = [name for name in self._inputs(known) if not (self.path / name).is_file()]
        unlisted, has = [name for name in there if name not in known], "is missing"
        if (self.path / _SUMS).is_file():
            has = f"has no checksum of {'it' if len(unlisted) == 1 else 'them'}"
        found = [
            (changed, "changed since the run began"),
            (missing, f"{'is' if len(missing) == 1 else 'are'} missing"),
            (unlisted, f"cannot be verified, since {_SUMS} {has}"),
        ]
        return [
            f"run folder {self.path}: {', '.join(names)} {problem}, so what is read or computed from "
            f"{'it' if len(names) == 1 else 'them'} (finger, limits, protocol) may not be the run's; put back an "
            "undamaged copy if you have one"
            for names, problem in found
            if names
        ]

    def copies(self) -> dict[str, bytes]:
        """Return the copied inputs by file name. Raises OSError."""
        return {name: read_bytes(self.path / name) for name in self._inputs(self.files)}

    def _inputs(self, known: Iterable[str]) -> list[str]:
        """Return the names of the copied inputs, among these names of files."""
        about: Any = None
        with contextlib.suppress(OSError, ValueError):  # the provenance itself is one of them
            about = json.loads(read_text(self.provenance))
        beside = about.get("beside", ()) if isinstance(about, dict) else ()
        return [*_COPIES, *(name for name in known if name.startswith(SHAPE_COPY) or name in (PLAN, *beside))]

    @property
    def busy(self) -> bool:
        """Whether another process writes to this run; no lock file is created to find out."""
        lock = self.path / _LOCK
        if not lock.is_file():
            return False
        try:
            with filelock.FileLock(lock, timeout=0):
                return False
        except filelock.Timeout:
            return True
        except OSError:  # The folder is read-only.
            return False

    @contextmanager
    def owned(self) -> Iterator[None]:
        """Lock the folder against other writing processes.

        Raises FolderBusyError; UnwritableError if no file can be written there.
        """
        lock = filelock.FileLock(self.path / _LOCK, timeout=0)
        try:
            lock.acquire()
        except filelock.Timeout:
            raise FolderBusyError(
                f"run folder {self.path} is in use by another process; wait until it ends"
            ) from None
        except OSError as error:
            raise UnwritableError.of(self.path / _LOCK, error) from error
        try:
            yield
        finally:
            lock.release()


def new_run_folder(
    parent: Path,
    name: str,
    when: datetime,
    protocol: Path,
    config_toml: str,
    provenance: Mapping[str, Any],
    more_files: Mapping[str, bytes] | None = None,
) -> RunFolder:
    """Create the folder of a run with copies of the protocol, the configuration and the versions.

    more_files: contents of the files that shapes and the script name, by the names of their copies. The folder
    appears with all of them, hashed, or not at all.
    """
    name = f"{when:%Y%m%dT%H%M%S}-{name}-{secrets.token_hex(3)}"
    partial = parent / f".{name}.part"
    try:
        partial.mkdir(parents=True)
    except OSError as error:
        raise UnwritableError.of(parent, error) from error
    try:
        replace_bytes(partial / "protocol.py", read_bytes(protocol))
        replace_text(partial / "config.toml", config_toml)
        replace_text(partial / "provenance.json", json.dumps(provenance, indent=2) + "\n")
        for copy, content in (more_files or {}).items():
            replace_bytes(partial / copy, content)
        RunFolder(partial).write_checksums(new=True)
        partial.rename(parent / name)
    except OSError:
        shutil.rmtree(partial, ignore_errors=True)
        raise
    return RunFolder(parent / name)


def rescued_folder(lost: RunFolder, contents: Mapping[str, bytes], otherwise: Path) -> RunFolder:
    """Write the rest of a run whose folder or files are lost into a new folder beside the old one, or in `otherwise`.

    The new folder can be resumed. Raises OSError if neither parent can be written to.
    """
    name = f"{lost.path.name}-rescued-{secrets.token_hex(3)}"
    try:
        return _written(lost.path.absolute().parent / name, contents)
    except OSError:
        return _written(otherwise / name, contents)


def _written(path: Path, contents: Mapping[str, bytes]) -> RunFolder:
    path.mkdir(parents=True)
    for name, content in contents.items():
        replace_bytes(path / name, content)
    folder = RunFolder(path)
    folder.write_checksums(new=True)
    return folder


def may_write_below(folder: Path) -> bool:
    """Return whether files can be written into a folder, which may have to be made first."""
    there = next((one for one in (folder, *folder.absolute().parents) if one.exists()), folder)
    return there.is_dir() and os.access(there, os.W_OK | os.X_OK)


def allowed(error: BaseException | None) -> bool:
    """Return whether a write failed, by the error or its cause, although this account may write there."""
    problem = error if error is None or isinstance(error, OSError) else error.__cause__
    return not (isinstance(problem, OSError) and problem.errno in _NOT_ALLOWED)


def how_to_write(error: BaseException | None) -> str:
    """Return what the operator does about a file that cannot be written."""
    return "free disk space" if allowed(error) else "make the folder writable for your account"


def free_space(path: Path) -> str:
    """Return the free disk space at a path, in words."""
    return f"{shutil.disk_usage(path if path.is_dir() else path.parent).free / 1e6:.0f} MB free"


_EVENT_BYTES, _RUN_BYTES = 2_000, 3_000_000
"""Size of a run per event, in the journal, the byte log and their exports, and of its pages."""


def refuse_full_disk(out: Path, events: int) -> None:
    """Raise BadInputError if the disk cannot hold a run's files; the folder `out` may not exist yet."""
    there = next((one for one in (out, *out.absolute().parents) if one.exists()), out)
    free, needed = shutil.disk_usage(there).free, events * _EVENT_BYTES + _RUN_BYTES
    if free < needed:
        raise BadInputError(
            f"{out}: the disk has {free / 1e6:.0f} MB free, and the run needs about "
            f"{needed / 1e6:.0f} MB; free some, or record on another disk with --out",
            "disk_full",
        )


def put_in_place(partial: Path, path: Path) -> None:
    """Replace a file by another one in one step; Windows waits for a program that reads it. Raises OSError."""
    clock = WallClock()
    deadline_s = clock.monotonic_s() + _READ_S
    while True:
        try:
            partial.replace(path)
        except PermissionError:
            if sys.platform == "win32" and clock.monotonic_s() < deadline_s:
                clock.wait_s(_AGAIN_S)
                continue
            raise
        return


def replace_text(path: Path, text: str, *, new: bool = False) -> None:
    """Replace a file on disk in one step, or write a new one. Raises UnwritableError, FileExistsError if `new`."""
    replace_bytes(path, text.encode("utf-8", "backslashreplace"), new=new)  # half of a surrogate pair


def replace_table(path: Path, header: Iterable[str], rows: Iterable[Iterable[object]]) -> None:
    """Replace a CSV table on disk in one step; a None is an empty cell. Raises UnwritableError."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    replace_text(path, text.getvalue())


def replace_bytes(path: Path, content: bytes, *, new: bool = False) -> None:
    """Replace a file on disk in one step, or write a new one. Raises UnwritableError, FileExistsError if `new`."""
    with replacement(path, new=new) as stream:
        write_all(stream, content)


def write_all(stream: io.FileIO, content: bytes | memoryview) -> None:
    """Write a whole content to an unbuffered file. Raises OSError."""
    left = memoryview(content)
    while left:
        left = left[stream.write(left) :]


@contextmanager
def replacement(path: Path, *, new: bool = False) -> Iterator[io.FileIO]:
    """Yield an unbuffered file, which replaces a file on disk in one step, or is a new one.

    Raises UnwritableError for any OSError, FileExistsError if `new`.
    """
    partial = path.with_name(path.name + ".part")
    try:
        with partial.open("wb+", buffering=0) as stream:
            yield stream
            os.fsync(stream.fileno())
        if new:
            os.link(partial, path)  # which replaces nothing, even if the file appears at this moment
            partial.unlink()
        else:
            put_in_place(partial, path)
    except BaseException as error:
        with contextlib.suppress(OSError):
            partial.unlink(missing_ok=True)
        if not isinstance(error, OSError) or isinstance(error, FileExistsError):
            raise
        raise UnwritableError.of(path, error) from error


def _digest(path: Path) -> str:
    return sha256_of(path)


SCRIPT = "identification_script.py"
"""Script name in the provenance of an identification."""

IDENTIFICATION_PAGE = "identification.html"
"""Page of an identification in the run folder, if a press was evaluated."""
