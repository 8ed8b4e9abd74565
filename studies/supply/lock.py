"""Resolve the versions of all dependencies and write them to the lock files in `requirements/`.

    make lock                 # keep the locked versions; add what pyproject.toml newly requires
    make lock NEWEST=yes      # the newest version of everything

One resolution covers Linux, macOS and Windows and every supported Python, with one version of each package where one
fits all. It needs the network: uv is installed in a folder that is removed afterwards.
"""

import argparse
import shutil
import tempfile
import tomllib
from pathlib import Path

from studies.release_check import CleanEnvironment
from studies.supply.locked import LOCKS, REQUIREMENTS, ROOT

EXTRAS = {"setup": (), "dev": ("dev",), "panel-test": ("panel-test",)}
OLDEST_PYTHON = {"setup": "3.11", "dev": "3.11.5", "panel-test": "3.11"}
"""Furo's parser of HTML needs 3.11.5."""

BUILD = "build.in"
OF_EDITABLE = "editables"
"""What hatchling requires for an editable install, besides pyproject.toml's `requires`."""

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
    (folder / BUILD).write_text("\n".join([*build, OF_EDITABLE]) + "\n", encoding="utf-8")
    before = REQUIREMENTS / "dev.txt"
    if before.exists() and not newest:
        shutil.copy(before, folder)
    # The largest set first: what is in an output file already is what uv prefers.
    texts = {}
    for lock in sorted(LOCKS, key=lambda name: name != "dev"):
        if lock != "dev":
            shutil.copy(folder / "dev.txt", folder / f"{lock}.txt")
        extras = [word for extra in EXTRAS[lock] for word in ("--extra", extra)]
        tools.run(
            *("uv", "pip", "compile", "--quiet", "--universal", "--python-version", OLDEST_PYTHON[lock]),
            *("--fork-strategy", "fewest", "--generate-hashes", "--no-emit-index-url", "--no-header", *extras),
            *("pyproject.toml", BUILD, "--output-file", f"{lock}.txt"),
        )
        texts[lock] = HEADER + (folder / f"{lock}.txt").read_text(encoding="utf-8")
    return texts


if __name__ == "__main__":
    main()
