"""What is to be drawn: a section of a finger, an indentor in front of it, and what a press is expected to do."""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Press:
    """One press of a run: its number among those of its purpose, its place and its target."""

    index: int
    purpose: str
    x_mm: float
    target: str  # doi_mm or force_gwt
    value: float


@dataclass(frozen=True)
class Job:
    """All that a drawing needs; config and, in a run's folder, its own copies of the files that shapes name."""

    config: Path
    folder: Path | None = None
    indentor: str | None = None
    along_mm: float = 0.0  # from the receptor plane
    press: Press | None = None
