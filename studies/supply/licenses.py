"""Table of the licenses of all locked packages, from the metadata of the installed ones.

    make licenses    # writes docs/licenses.csv

A package that is installed on other systems or Pythons only keeps the row that it has; one without a row is named.
"""

import csv
import sys
from collections.abc import Iterator, Mapping
from importlib.metadata import PackageNotFoundError, metadata
from io import StringIO
from pathlib import Path

from studies.supply.locked import REQUIREMENTS, ROOT, Pin, all_locked, read_lock, required

TABLE = ROOT / "docs" / "licenses.csv"
HEADER = ("package", "license, as the package states it", "needed by")
SHORTEST = 60
"""Characters; a longer field is the text of a license."""

READ: Mapping[str, str] = {
    "axe-playwright-python": "MIT",
    "colorama": "BSD License",
    "historydict": "BSD-3-Clause",
    "quantities": "BSD-3-Clause",
}
"""Where the metadata names none, from the license file or the module; colorama is installed on Windows only."""


def main() -> None:
    """Write the table, or name the packages whose license is not known here."""
    rows = list(table(all_locked(), stored()))
    if unknown := [name for name, license_, _ in rows if not license_]:
        sys.exit(f"licenses: not installed here, and without a row: {', '.join(unknown)}")
    text = StringIO()
    csv.writer(text, lineterminator="\n").writerows((HEADER, *rows))
    TABLE.write_text(text.getvalue(), encoding="utf-8")


def stored(path: Path = TABLE) -> dict[str, str]:
    """Return the license of each package in the table."""
    if not path.exists():
        return {}
    with path.open(encoding="utf-8", newline="") as file:
        return {row[0]: row[1] for row in list(csv.reader(file))[1:]}


def table(pins: Mapping[str, Pin], known: Mapping[str, str]) -> Iterator[tuple[str, str, str]]:
    """Yield the rows: package, license or an empty text, and what needs it."""
    setup = read_lock(REQUIREMENTS / "setup.txt")
    program = required(setup)
    for name in sorted(pins):
        needed_by = "program" if name in program else "build" if name in setup else "extras"
        yield name, stated(name) or known.get(name, ""), needed_by


def stated(name: str) -> str:
    """Return the license that a package's metadata states; empty where the package is not installed."""
    if name in READ:
        return READ[name]
    try:
        about = metadata(name)
    except PackageNotFoundError:
        return ""
    if "License-Expression" in about:
        return about["License-Expression"]
    if "License" in about:
        text = about["License"]
        if 0 < len(text) <= SHORTEST and "\n" not in text:
            return text
    classifiers = (str(one) for one in about.get_all("Classifier") or ())
    return "; ".join(one.rpartition(" :: ")[2] for one in classifiers if one.startswith("License ::"))


if __name__ == "__main__":
    main()
