"""The run that goes on, where nobody announced it: the newest one whose journal is being written to."""

import stat
from pathlib import Path

from rig.data.folder import RunFolder

GROWS_S = 5.0
"""A journal that was written to so lately is one that goes on."""
_NEWEST = 50  # folders, whose names begin with the time


def growing(out: Path, unix_s: float) -> Path | None:
    """A run's folder below `out`; None where nothing is written to."""
    try:
        names = sorted((path.name for path in out.iterdir() if not path.name.startswith(".")), reverse=True)
    except OSError:
        return None
    found = [(written_s(out / name), out / name) for name in names[:_NEWEST]]
    then_s, path = max(found, key=lambda one: one[0], default=(0.0, None))
    return path if unix_s - then_s < GROWS_S else None


def written_s(run: Path) -> float:
    """When a run's journal was last written to; 0 where it has none."""
    try:
        about = RunFolder(run).events.stat()
    except OSError:
        return 0.0
    return about.st_mtime if stat.S_ISREG(about.st_mode) else 0.0
