"""The lock files in `requirements/`, read."""

import re
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
REQUIREMENTS = ROOT / "requirements"
PROJECT = "indentation-rig"
LOCKS = ("setup", "dev", "panel-test")
"""Without `.txt`: what `make setup` installs, what `make check` needs besides, and what `make panel-test` needs."""

_PIN = re.compile(r"(?P<name>[\w.-]+)==(?P<version>[\w.+!-]+)(?: ; (?P<marker>.+))?")


@dataclass(frozen=True)
class Pin:
    """One package of a lock file.

    Attributes
    ----------
    name, version, marker : str
        The marker is empty where the package is installed everywhere.
    hashes : frozenset of str
        SHA-256 of every distribution file that pip may install.
    required_by : tuple of str
        Names of the packages that require it, as the lock file's comments list them.
    """

    name: str
    version: str
    marker: str
    hashes: frozenset[str]
    required_by: tuple[str, ...]


def read_lock(path: Path) -> dict[str, Pin]:
    """Return the packages of a lock file by name.

    Raises
    ------
    ValueError
        A line is neither an exact version nor one of its hashes.
    """
    pins: dict[str, Pin] = {}
    for entry in re.split(r"^(?=[\w.-]+==)", _uncommented(path), flags=re.MULTILINE)[1:]:
        first, *rest = entry.strip().splitlines()
        pin = _PIN.fullmatch(first.removesuffix("\\").strip())
        hashes = [line.strip().removesuffix("\\").strip() for line in rest if not line.strip().startswith("#")]
        if pin is None or not hashes or not all(re.fullmatch(r"--hash=sha256:[\da-f]{64}", one) for one in hashes):
            raise ValueError(f"{path.name}: expected an exact version and its hashes, not {first!r}")
        notes = (line.strip().lstrip("# ").removeprefix("via").strip() for line in rest if "#" in line)
        required_by = tuple(note.split(" (")[0] for note in notes if note)
        pins[pin["name"]] = Pin(
            pin["name"],
            pin["version"],
            pin["marker"] or "",
            frozenset(one.removeprefix("--hash=sha256:") for one in hashes),
            required_by,
        )
    return pins


def _uncommented(path: Path) -> str:
    """Return the text below the header."""
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    while lines and lines[0].startswith("#"):
        del lines[0]
    text = "".join(lines)
    if text and not re.match(r"[\w.-]+==", text):
        raise ValueError(f"{path.name}: expected an exact version, not {text.splitlines()[0]!r}")
    return text


def all_locked() -> dict[str, Pin]:
    """Return the packages of every lock file by name."""
    return {name: pin for lock in LOCKS for name, pin in read_lock(REQUIREMENTS / f"{lock}.txt").items()}


def required(pins: dict[str, Pin], root: str = PROJECT) -> dict[str, list[str]]:
    """Return what each package requires, for the root and all that it requires directly or not."""
    found: dict[str, list[str]] = {}
    waiting = [root]
    while waiting:
        name = waiting.pop()
        if name not in found:
            found[name] = sorted(pin.name for pin in pins.values() if name in pin.required_by)
            waiting += found[name]
    return dict(sorted(found.items()))
