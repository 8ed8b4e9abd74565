"""Resolve the versions of all dependencies and write them to the lock files in `requirements/`.

    make lock                 # keep the locked versions; add what pyproject.toml newly requires
    make lock NEWEST=yes      # the newest version of everything

One resolution covers Linux, macOS and Windows and every supported Python, with one version of each package where one
fits all. It needs the network: uv is installed in a folder that is removed afterwards.
"""

import argparse
import re
import shutil
import tempfile
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from studies.release_check import CleanEnvironment
from studies.supply.locked import BASES, LOCKS, REQUIREMENTS, ROOT, entries

EXTRAS = {"setup": (), "dev": ("dev",), "panel-test": ("dev", "panel-test")}
OLDEST_PYTHON = {"setup": "3.11", "dev": "3.11.5", "panel-test": "3.11.5"}
"""Furo's parser of HTML needs 3.11.5."""

BUILD = "build.in"

PROMISED = re.compile(
    r"-(?:py3|py2\.py3|cp3\d+)-(?:none|abi3|cp31[1234])-"
    r"(?:any|win_amd64|macosx_\w+|(?:[\w.]+\.)?(?:many)?linux\w*_(?:x86_64|aarch64))(?:\.\w+)*\.whl$|\.(?:tar\.gz|zip)$"
)
"""Distribution files whose hashes are locked: of the systems and Pythons in docs/releasing.md, and sources."""

HEADER = "# Written by `make lock`; docs/releasing.md describes how to update it.\n"


def main() -> None:
    """Write the three files."""
    parser = argparse.ArgumentParser(prog="python -m studies.supply.lock", description="Lock all dependencies.")
    parser.add_argument("--newest", action="store_true", help="Move every package to its newest version.")
    newest = parser.parse_args().newest
    with tempfile.TemporaryDirectory() as folder:
        texts = resolved(Path(folder), newest=newest)
    for lock, text in texts.items():
        (REQUIREMENTS / f"{lock}.txt").write_text(text, encoding="utf-8")
    print(f"written: {', '.join(f'requirements/{lock}.txt' for lock in texts)}")


def scratch(folder: Path) -> CleanEnvironment:
    """Return an environment that has uv."""
    tools = CleanEnvironment(folder)
    tools.run("python", "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "uv")
    return tools


def resolved(folder: Path, *, newest: bool) -> dict[str, str]:
    """Return the text of each lock file."""
    tools = scratch(folder)
    shutil.copy(ROOT / "pyproject.toml", folder)
    build = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["build-system"]["requires"]
    (folder / BUILD).write_text("\n".join(build) + "\n", encoding="utf-8")
    known: dict[str, str] = {}
    for lock in () if newest else LOCKS:
        known |= entries(REQUIREMENTS / f"{lock}.txt")[1]
    # The largest set first: what is in an output file already is what uv prefers.
    preferred = "".join(known.values())
    found: dict[str, dict[str, str]] = {"": {}}
    for lock in reversed(LOCKS):
        output = folder / f"{lock}.txt"
        output.write_text(preferred, encoding="utf-8")
        extras = [word for extra in EXTRAS[lock] for word in ("--extra", extra)]
        tools.run(
            *("uv", "pip", "compile", "--quiet", "--universal", "--python-version", OLDEST_PYTHON[lock]),
            *("--fork-strategy", "fewest", "--generate-hashes", "--no-emit-index-url", "--no-header", *extras),
            *("pyproject.toml", BUILD, "--output-file", output.name),
        )
        preferred, (_, found[lock]) = output.read_text(encoding="utf-8"), entries(output)
    hashes, texts = promised_hashes(tools), {}
    for lock, base in BASES.items():
        added = [name for name in found[lock] if name not in found[base]]
        head = f"{HEADER}-r {base}.txt\n" if base else HEADER
        texts[lock] = head + "".join(only(found[lock][name], hashes) for name in added)
    return texts


def promised_hashes(tools: CleanEnvironment) -> frozenset[str]:
    """Return the hashes of all promised distribution files of the largest set."""
    return frozenset(
        str(file["hashes"]["sha256"])
        for one in published(tools)
        for file in (*one.get("wheels", ()), one.get("sdist"))
        if file and PROMISED.search(filename(file))
    )


def published(tools: CleanEnvironment) -> list[dict[str, Any]]:
    """Return what the index lists of the largest set, whose lock file is in the folder of the tools."""
    tools.run(
        *("uv", "pip", "compile", "--quiet", "--universal", "--python-version", OLDEST_PYTHON[LOCKS[-1]]),
        *("--no-deps", "--no-header", "--format", "pylock.toml", "--output-file", "pylock.toml", f"{LOCKS[-1]}.txt"),
    )
    found: list[dict[str, Any]] = tomllib.loads((tools.folder / "pylock.toml").read_text("utf-8"))["packages"]
    return found


def filename(file: Mapping[str, Any]) -> str:
    """Return the name of a distribution file of pylock.toml."""
    return str(file.get("name") or (file.get("url") or file["path"]).rpartition("/")[2])


def only(text: str, hashes: frozenset[str]) -> str:
    """Return a package's lines without the hashes of other files."""
    first, *lines = text.splitlines()
    notes = [line for line in lines if "#" in line]
    kept = [
        line.removesuffix("\\").rstrip()
        for line in lines
        if (found := re.search(r"sha256:(\w{64})", line)) and found[1] in hashes
    ]
    return "\n".join([first, " \\\n".join(kept), *notes]) + "\n"


if __name__ == "__main__":
    main()
