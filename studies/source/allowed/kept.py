"""Tables of the study on disk: a row a finger, written when it is there; beside them what made them."""

import csv
import datetime
import json
import platform
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy
from numpy.typing import NDArray

from sim.models.cache import simulator_code

Array = NDArray[np.float64]
RESULTS = Path(__file__).parent / "results"
COMMAND = "python -m studies.source.allowed"
DIGITS = 6


@dataclass(frozen=True)
class FingerSample:
    """Fingers that were asked: (n,) numbers within the design, values (n, parameters), facts (n, facts)."""

    numbers: NDArray[np.int64]
    values: Array
    facts: Array

    def of(self, chosen: NDArray[np.bool_]) -> "FingerSample":
        """Some of them."""
        return FingerSample(self.numbers[chosen], self.values[chosen], self.facts[chosen])


def together(tables: Sequence[FingerSample]) -> FingerSample:
    """All rows."""
    return FingerSample(
        *(np.concatenate([getattr(t, name) for t in tables]) for name in ("numbers", "values", "facts"))
    )


def append(path: Path, number: int, values: Mapping[str, float], facts: Mapping[str, float]) -> None:
    """One finger; not a number is an empty cell."""
    row = {"finger": number, **{name: _short(v) for name, v in (values | facts).items()}}  # type: ignore[operator]
    new = not path.exists()
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(row), lineterminator="\n")
        if new:
            writer.writeheader()
        writer.writerow(row)


def _short(value: float) -> str:
    return f"{value:.{DIGITS}g}" if np.isfinite(value) else ""


def read(path: Path, parameters: Sequence[str], facts: Sequence[str]) -> FingerSample:
    """The fingers of a table, none where there is no file yet. Raises KeyError where a column is missing."""
    rows: list[dict[str, str]] = []
    if path.exists():
        with path.open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))

    def columns(names: Sequence[str]) -> Array:
        return np.array([[float(row[name] or "nan") for name in names] for row in rows]).reshape(-1, len(names))

    return FingerSample(
        np.array([int(row["finger"]) for row in rows], dtype=np.int64), columns(parameters), columns(facts)
    )


def begin_anew(path: Path, **told: object) -> None:
    """Forget a table that was made of something else than is told; none is forgotten where there is none."""
    beside = path.with_suffix(".json")
    if beside.exists():
        said = json.loads(beside.read_text(encoding="utf-8"))
        if any(said.get(name) != value for name, value in told.items()):
            path.unlink(missing_ok=True)


def write_provenance(path: Path, **more: object) -> None:
    """What makes a table, beside it: wave_1.csv has wave_1.json."""
    told = {
        "command": COMMAND,
        "commit": _commit(),
        "simulator": simulator_code()[:16],
        "python": platform.python_version(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "date": datetime.datetime.now(datetime.UTC).date().isoformat(),
        **more,
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    path.with_suffix(".json").write_text(json.dumps(told, indent=2) + "\n", encoding="utf-8")


def _commit() -> str:
    asked = ["git", "-C", str(Path(__file__).parent), "rev-parse", "--short=12", "HEAD"]
    return subprocess.run(asked, capture_output=True, text=True, check=False).stdout.strip() or "unknown"
