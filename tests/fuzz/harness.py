"""One input after another for a reader of files: write it, read it, and see what became of it."""

import fnmatch
import os
import shutil
from pathlib import Path

from tests.fuzz.readers import READERS, failure_of


class Target:
    """A reader with its examples and its folder, which begins empty.

    Parameters
    ----------
    name : str
        Name of the reader.
    folder : Path
        Folder that does not exist yet.
    """

    def __init__(self, name: str, folder: Path) -> None:
        self._reader, self._folder = READERS[name], folder
        scratch = folder.with_name(f"{folder.name} examples")
        scratch.mkdir(parents=True)
        self.examples = list(self._reader.examples(scratch))
        shutil.rmtree(scratch)
        self.path = folder / self._reader.file
        self.path.parent.mkdir(parents=True)
        self._reader.beside(self.path)
        self._there = self._files()
        self.succeeded = False  # the last input was read without an error

    def failure(self, content: bytes) -> str:
        """Return what is wrong with how the program reads a file of this content, or nothing."""
        if self.path.is_file():
            self.path.unlink()
        self.path.write_bytes(content)
        self.succeeded = False

        def read(path: Path) -> None:
            self._reader.read(path)
            self.succeeded = True

        found = failure_of(read, self.path)
        written = sorted(name for name in self._files() - self._there if not self._may_write(name))
        if written and not found:
            found = f"wrote {written}"
        if not found and not self._may_write(self._reader.file) and self.path.read_bytes() != content:
            found = "changed the file"
        return found

    def _files(self) -> set[str]:
        return {
            os.path.relpath(os.path.join(where, name), self._folder)
            for where, _, names in os.walk(self._folder)
            for name in names
        } - {self._reader.file}

    def _may_write(self, name: str) -> bool:
        return any(fnmatch.fnmatch(name, pattern) for pattern in self._reader.writes)
