"""Bill of materials of a release, in CycloneDX 1.6: what `pip install` installs, and the wheel's files by others.

`make release-check` writes it to `dist/` and validates it. Versions are those of `requirements/setup.txt`, which also
holds the hashes of the packages. It needs nothing but Python.
"""

import csv
import json
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from uuid import NAMESPACE_URL, uuid5

from studies.supply.licenses import stored
from studies.supply.locked import PROJECT, REQUIREMENTS, ROOT, Pin, read_lock, required

VENDORED = ROOT / "docs" / "vendored.csv"
SPDX = frozenset(
    (
        *("0BSD", "Apache-2.0", "BSD-2-Clause", "BSD-3-Clause", "CC0-1.0", "ISC", "LGPL-3.0-only", "LLVM-exception"),
        *("MIT", "MIT-CMU", "MPL-2.0", "PSF-2.0", "Zlib"),
    )
)
"""Identifiers of the SPDX list that occur; any other license is a name."""


def vendored() -> list[dict[str, str]]:
    """Return the rows of the table of files that others made."""
    with VENDORED.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def bill() -> dict[str, Any]:
    """Return the whole bill, the same for the same tree."""
    about = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    pins = read_lock(REQUIREMENTS / "setup.txt")
    needed = required(pins)
    root = f"pkg:pypi/{PROJECT}@{about['version']}"
    ref = {name: root if name == PROJECT else _purl(pins[name]) for name in needed}
    known = stored()
    files = list(_files())
    content: dict[str, Any] = {
        "metadata": {
            "component": {
                **{"type": "application", "bom-ref": root, "purl": root, "name": PROJECT},
                **{"version": about["version"], "description": about["description"]},
                "licenses": _license(about["license"]),
            }
        },
        "components": [
            *(_package(pins[name], known[name]) for name in needed if name != PROJECT),
            *files,
        ],
        "dependencies": [
            *({"ref": ref[name], "dependsOn": [ref[one] for one in needed[name]]} for name in needed),
        ],
    }
    content["dependencies"][list(needed).index(PROJECT)]["dependsOn"] += [one["bom-ref"] for one in files]
    number = uuid5(NAMESPACE_URL, json.dumps(content, sort_keys=True))
    head = {"bomFormat": "CycloneDX", "specVersion": "1.6", "serialNumber": f"urn:uuid:{number}", "version": 1}
    return head | content


def write_bill(folder: Path) -> Path:
    """Write the bill and return its path."""
    bom = bill()
    path = folder / f"{PROJECT}-{bom['metadata']['component']['version']}.cdx.json"
    path.write_text(json.dumps(bom, indent=1) + "\n", encoding="utf-8")
    return path


def _purl(pin: Pin) -> str:
    return f"pkg:pypi/{pin.name}@{pin.version}"


def _package(pin: Pin, license_: str) -> dict[str, Any]:
    component = {
        **{"type": "library", "bom-ref": _purl(pin), "purl": _purl(pin), "name": pin.name, "version": pin.version},
        "licenses": _license(license_),
    }
    if pin.marker:
        component |= {"scope": "optional", "properties": [{"name": "python:marker", "value": pin.marker}]}
    return component


def _license(text: str) -> list[dict[str, Any]]:
    words = {*re.split(r" (?:AND|OR|WITH) ", text)}
    return [{"expression": text}] if words <= SPDX else [{"license": {"name": text}}]


def _files() -> Iterator[dict[str, Any]]:
    """Yield what others made and the wheel contains, with its files."""
    rows = vendored()
    for name in dict.fromkeys(row["project"] for row in rows):
        own = [row for row in rows if row["project"] == name]
        version, npm = own[0]["version"], re.fullmatch(r"npm package (\S+)", own[0]["source"])
        component: dict[str, Any] = {
            "type": "library" if npm else "data",
            "bom-ref": name,
            "name": name,
            "version": version,
            "description": own[0]["source"],
            "licenses": _license(own[0]["license"]),
            "components": [
                {
                    **{"type": "file", "bom-ref": row["file"], "name": row["file"]},
                    "hashes": [{"alg": "SHA-256", "content": row["sha256"]}],
                }
                for row in own
            ],
        }
        yield component | ({"purl": f"pkg:npm/{npm[1]}@{version}"} if npm else {})
