"""The folder of one run: copies of everything that made it, hashed, beside what it recorded."""

import hashlib
import json
import os
import secrets
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any


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
    def provenance(self) -> Path:
        """Versions, command and parameters."""
        return self.path / "provenance.json"

    def write_checksums(self) -> None:
        """SHA256SUMS over every file of the folder, as `sha256sum -c` reads it."""
        names = sorted(p.name for p in self.path.iterdir() if p.is_file() and p.name != "SHA256SUMS")
        lines = [f"{hashlib.sha256((self.path / name).read_bytes()).hexdigest()}  {name}\n" for name in names]
        replace_text(self.path / "SHA256SUMS", "".join(lines))


def new_run_folder(
    parent: Path, name: str, when: datetime, protocol: Path, config_toml: str, provenance: Mapping[str, Any]
) -> RunFolder:
    """Make a folder of its own for a run and copy the protocol, the configuration and the versions into it."""
    path = parent / f"{when:%Y%m%dT%H%M%S}-{name}-{secrets.token_hex(3)}"
    path.mkdir(parents=True)
    folder = RunFolder(path)
    (path / "protocol.py").write_bytes(protocol.read_bytes())
    (path / "config.toml").write_text(config_toml, encoding="utf-8")
    folder.provenance.write_text(json.dumps(provenance, indent=2) + "\n", encoding="utf-8")
    return folder


def replace_text(path: Path, text: str) -> None:
    """Write a file so that it is either the old one or the whole new one, on disk."""
    partial = path.with_name(path.name + ".part")
    with partial.open("w", encoding="utf-8", newline="") as stream:
        stream.write(text)
        stream.flush()
        os.fsync(stream.fileno())
    partial.replace(path)
