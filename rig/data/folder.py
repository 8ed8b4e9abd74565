"""The folder of one run: copies of everything that made it, hashed, beside what it recorded."""

import contextlib
import errno
import hashlib
import json
import os
import secrets
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import filelock

from rig.errors import RigError

_SUMS, _LOCK = "SHA256SUMS", ".lock"
_FULL = (errno.ENOSPC, errno.EDQUOT)
_COPIES = ("protocol.py", "config.toml", "provenance.json")
SHAPE_COPY = "shape_"
"""Copies of the files that shapes name begin so."""


class FolderBusyError(RigError):
    """Another process writes to this run."""

    default_code = "folder_busy"


class UnwritableError(RigError, OSError):
    """A file cannot be written, and is what it was before."""

    default_code = "unwritable"

    @classmethod
    def of(cls, path: Path, error: OSError) -> "UnwritableError":
        """What kept a file from being written, as an error about that file."""
        reason, free = error.strerror or str(error), free_space(path)
        made = cls("{path}: cannot be written: {reason}, {free}", path=str(path), reason=reason, free=free)
        made.errno, made.filename = error.errno, str(path)
        made.strerror = f"cannot be written: {reason}, {free}"
        return made

    def __str__(self) -> str:
        return str(self.args[0])  # an OSError would put its number before it

    def __reduce__(self) -> tuple[Any, ...]:
        again, whose, state = super().__reduce__()  # without what an OSError keeps outside of its __dict__
        return again, whose, {**state, "errno": self.errno, "strerror": self.strerror, "filename": self.filename}


@dataclass(frozen=True)
class RunFolder:
    """Names of the files in a run folder."""

    path: Path

    @property
    def events(self) -> Path:
        """The journal: the truth about the run."""
        return self.path / "events.jsonl"

    @property
    def bytes_log(self) -> Path:
        """Every chunk that went over the wire."""
        return self.path / "bytes.jsonl"

    @property
    def data(self) -> Path:
        """Everything recorded, as HDF5."""
        return self.path / "data.h5"

    @property
    def report(self) -> Path:
        """The HTML report."""
        return self.path / "report.html"

    @property
    def config(self) -> Path:
        """The whole configuration that the run went by."""
        return self.path / "config.toml"

    @property
    def provenance(self) -> Path:
        """Versions, command and parameters."""
        return self.path / "provenance.json"

    @property
    def files(self) -> set[str]:
        """Names of all the files that are there, but for the checksums."""
        return {p.name for p in self.path.iterdir() if p.is_file() and p.name not in (_SUMS, _LOCK)}

    def write_checksums(self) -> None:
        """SHA256SUMS over every file of the folder, as `sha256sum -c` reads it."""
        self._write_sums({name: _digest(self.path / name) for name in self.files})

    def add_checksums(self, made: set[str]) -> None:
        """The same over files that were made just now or have no line yet, the other lines as they were."""
        known = self._known_sums()
        new = made | (self.files - set(known))
        if new:
            self._write_sums(known | {name: _digest(self.path / name) for name in new})

    def _write_sums(self, sums: Mapping[str, str]) -> None:
        replace_text(self.path / _SUMS, "".join(f"{sums[name]}  {name}\n" for name in sorted(sums)))

    def _known_sums(self) -> dict[str, str]:
        lines = (self.path / _SUMS).read_text(encoding="utf-8").splitlines()
        return {name: digest for digest, name in (line.split("  ", 1) for line in lines)}

    def changed(self) -> list[str]:
        """Which of the copies that a run was made from are not what they were when it began. Raises OSError."""
        known = self._known_sums()
        copies = [*_COPIES, *(name for name in known if name.startswith(SHAPE_COPY))]
        return [name for name in copies if known.get(name) != _digest(self.path / name)]

    def copies(self) -> dict[str, bytes]:
        """Return what the run was made from, by file name. Raises OSError."""
        names = [*_COPIES, *(name for name in self.files if name.startswith(SHAPE_COPY))]
        return {name: (self.path / name).read_bytes() for name in names}

    @property
    def busy(self) -> bool:
        """Whether another process writes to this run; a lock is looked at where there is one, and made nowhere."""
        lock = self.path / _LOCK
        if not lock.is_file():
            return False
        try:
            with filelock.FileLock(lock, timeout=0):
                return False
        except filelock.Timeout:
            return True
        except OSError:  # of a folder that nobody may write to
            return False

    @contextmanager
    def owned(self) -> Iterator[None]:
        """Hold the folder against every other process that would write to it.

        Raises FolderBusyError; UnwritableError on a full disk.
        """
        lock = filelock.FileLock(self.path / _LOCK, timeout=0)
        try:
            lock.acquire()
        except filelock.Timeout:
            raise FolderBusyError(
                "run folder {run} is in use by another process; wait until it ends", run=str(self.path)
            ) from None
        except OSError as error:
            if error.errno in _FULL:
                raise UnwritableError.of(self.path / _LOCK, error) from error
            raise
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
    shape_files: Mapping[str, bytes] | None = None,
) -> RunFolder:
    """Make a folder of its own for a run, with copies of the protocol, the configuration and the versions.

    shape_files: what the files that shapes name hold, by the names of their copies. The folder is there with all of
    them, hashed, or not at all.
    """
    name = f"{when:%Y%m%dT%H%M%S}-{name}-{secrets.token_hex(3)}"
    partial = parent / f".{name}.part"
    partial.mkdir(parents=True)
    try:
        replace_bytes(partial / "protocol.py", protocol.read_bytes())
        replace_text(partial / "config.toml", config_toml)
        replace_text(partial / "provenance.json", json.dumps(provenance, indent=2) + "\n")
        for copy, content in (shape_files or {}).items():
            replace_bytes(partial / copy, content)
        RunFolder(partial).write_checksums()
        partial.rename(parent / name)
    except OSError:
        shutil.rmtree(partial, ignore_errors=True)
        raise
    return RunFolder(parent / name)


def rescued_folder(lost: RunFolder, contents: Mapping[str, bytes], otherwise: Path) -> RunFolder:
    """Write what is left of a run whose folder or files are lost into a new folder beside the old one.

    Parameters
    ----------
    lost : RunFolder
        Where the run was.
    contents : mapping of str to bytes
        Files, by name.
    otherwise : Path
        Where the new folder goes if the old one's parent cannot be written to.

    Returns
    -------
    RunFolder
        A folder that can be resumed.

    Raises
    ------
    OSError
        If it can be written in neither place.
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
    folder.write_checksums()
    return folder


def free_space(path: Path) -> str:
    """How much room there is beside a file or in a folder."""
    return f"{shutil.disk_usage(path if path.is_dir() else path.parent).free / 1e6:.0f} MB free"


def replace_text(path: Path, text: str) -> None:
    """Write a file so that it is either the old one or the whole new one, on disk."""
    replace_bytes(path, text.encode("utf-8"))


def replace_bytes(path: Path, content: bytes) -> None:
    """Write a file so that it is either the old one or the whole new one, on disk. Raises UnwritableError."""
    partial = path.with_name(path.name + ".part")
    try:
        with partial.open("wb") as stream:
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
        partial.replace(path)
    except OSError as error:
        with contextlib.suppress(OSError):
            partial.unlink(missing_ok=True)
        raise UnwritableError.of(path, error) from error


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


SCRIPT = "meeting_script.py"
"""What the provenance of a meeting names as its script."""

MEETING_PAGE = "meeting.html"
"""In the folder of the run, once it has ended with something learned."""
