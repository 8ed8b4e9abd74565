"""The lock files in `requirements/`, read."""

import re
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
REQUIREMENTS = ROOT / "requirements"
PROJECT = "indentation-rig"
BASES = {"setup": "", "dev": "setup", "panel-test": "dev"}
"""Lock files without `.txt`, and the one that each adds to.

`make setup` installs the first, `make check` needs the second, `make panel-test` the third.
"""
LOCKS = tuple(BASES)

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
    """Return the packages of a lock file by name, with those of the file that it adds to.

    Raises
    ------
    ValueError
        A line is neither an exact version nor one of its hashes, or a package is locked twice.
    """
    base, texts = entries(path)
    pins = read_lock(path.with_name(base)) if base else {}
    for name, text in texts.items():
        first, *rest = text.strip().splitlines()
        pin = _PIN.fullmatch(first.removesuffix("\\").strip())
        hashes = [line.strip().removesuffix("\\").strip() for line in rest if not line.strip().startswith("#")]
        if pin is None or not hashes or not all(re.fullmatch(r"--hash=sha256:[\da-f]{64}", one) for one in hashes):
            raise ValueError(f"{path.name}: expected an exact version and its hashes, not {first!r}")
        if name in pins:
            raise ValueError(f"{path.name}: {base} locks {name}, too")
        notes = (line.strip().lstrip("# ").removeprefix("via").strip() for line in rest if "#" in line)
        required_by = tuple(note.split(" (")[0] for note in notes if note)
        pins[name] = Pin(
            name,
            pin["version"],
            pin["marker"] or "",
            frozenset(one.removeprefix("--hash=sha256:") for one in hashes),
            required_by,
        )
    return pins


def entries(path: Path) -> tuple[str, dict[str, str]]:
    """Return the name of the file that a lock file adds to, and the text of each of its own packages.

    Raises
    ------
    ValueError
        The file begins with anything else.
    """
    head, *packages = re.split(r"^(?=[\w.-]+==)", path.read_text(encoding="utf-8"), flags=re.MULTILINE)
    said = "\n".join(line for line in head.splitlines() if not line.startswith("#"))
    base = re.fullmatch(r"(?:-r (?P<base>[\w-]+\.txt))?", said)
    if base is None or not packages:
        raise ValueError(f"{path.name}: expected an exact version, not {said!r}")
    return base["base"] or "", {text.partition("==")[0]: text for text in packages}


def all_locked() -> dict[str, Pin]:
    """Return the packages of every lock file by name."""
    return read_lock(REQUIREMENTS / f"{LOCKS[-1]}.txt")


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
