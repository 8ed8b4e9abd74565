"""Is this tree fit to be released? Built, checked and installed where nothing else is, and tried there.

    make release-check    # some minutes, and the network: build, twine and all that the program needs

Nothing is uploaded, and nothing is installed but into a folder that is removed. What was built is left in dist/.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
import venv
from collections.abc import Iterator
from pathlib import Path

from studies.supply.sbom import write_bill

ROOT = Path(__file__).parents[1]
TOOLS = ("build", "twine", "cyclonedx-python-lib[json-validation]")
VALID = """\
import sys
from pathlib import Path

from cyclonedx.schema import SchemaVersion
from cyclonedx.validation.json import JsonStrictValidator

wrong = JsonStrictValidator(SchemaVersion.V1_6).validate_str(Path(sys.argv[1]).read_text(encoding="utf-8"))
sys.exit(f"{sys.argv[1]}: {wrong}" if wrong else 0)
"""
"""Whether a bill of materials has the form of CycloneDX 1.6."""

SCRIPT = """\
def run(rig):
    rig.mount("bar:3.0")
    rig.home()
    rig.zero()
    for x_mm in (-0.5, 0.5):
        rig.move_to(x_mm=x_mm)
        rig.indent(doi_mm=0.3, hold_s=0.2)
"""
EVERYTHING = """\
import importlib, pkgutil, sys

for package in ("rig", "sim", "rig_shared"):
    for found in pkgutil.walk_packages([importlib.import_module(package).__path__[0]], package + "."):
        if not found.name.startswith({left_out}):
            importlib.import_module(found.name)
print(sys.modules["rig"].__file__)
"""
OF_EXTRAS = ("rig.study.dask_cluster", "rig.__main__")
"""Not imported, by how their names begin: what only an extra brings along, and what is the program itself."""


class NotFitError(Exception):
    """What a release must not have."""


class CleanEnvironment:
    """An environment of its own."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        venv.create(folder, with_pip=True)

    def run(self, *words: str | Path, code: int = 0) -> "subprocess.CompletedProcess[str]":
        """Run a program of it, which knows of no other environment. Raises NotFitError."""
        program = self.folder / ("Scripts" if os.name == "nt" else "bin") / words[0]
        kept = {
            name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "RIG_", "VIRTUAL"))
        }
        here = {"RIG_CACHE_DIR": str(self.folder / "cache"), "RIG_STATE_DIR": str(self.folder / "state")}
        done = subprocess.run(
            [program, *words[1:]], cwd=self.folder, env=kept | here, capture_output=True, text=True, check=False
        )
        if done.returncode != code:
            raise NotFitError(f"{' '.join(map(str, words))}: {done.returncode}\n{done.stdout}{done.stderr}")
        return done


def main() -> None:
    """Say what was checked, line by line; ends with 1 at the first that fails."""
    try:
        for line in checks():
            print(line, flush=True)
    except NotFitError as error:
        sys.exit(f"not fit to be released: {error}")
    print("fit to be released")


def checks() -> Iterator[str]:
    """Each when it has passed. Raises NotFitError."""
    version = stated_version()
    yield f"version {version}: the same in pyproject.toml, CITATION.cff and CHANGELOG.md"
    with tempfile.TemporaryDirectory() as folder:
        tools = CleanEnvironment(Path(folder) / "tools")
        made = built(tools)
        yield f"built, and twine finds nothing: {', '.join(path.name for path in made)}"
        bill = write_bill(ROOT / "dist")
        tools.run("python", "-c", VALID, bill)
        yield f"{bill.name}: a valid bill of materials"
        place = CleanEnvironment(Path(folder) / "clean")
        (wheel,) = (path for path in made if path.suffix == ".whl")
        place.run("python", "-m", "pip", "install", "--quiet", "--disable-pip-version-check", wheel)
        yield f"{wheel.name} installed in an empty environment, without extras"
        yield from tried(place, version)


def stated_version() -> str:
    """Of pyproject.toml. Raises NotFitError where another file says another."""
    version = str(tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"])
    for name, pattern in {"CITATION.cff": r"^version: (.*)$", "CHANGELOG.md": r"^## (?:\[)?v?([\d.]+)"}.items():
        found = re.search(pattern, (ROOT / name).read_text(encoding="utf-8"), flags=re.M)
        if found is None or found[1] != version:
            raise NotFitError(f"{name}: expected version {version}")
    return version


def built(tools: CleanEnvironment) -> list[Path]:
    """The source distribution, and the wheel that is made from it. Raises NotFitError."""
    tools.run("python", "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *TOOLS)
    out = tools.folder / "dist"
    tools.run("python", "-m", "build", "--outdir", out, ROOT)
    made = sorted(out.iterdir())
    tools.run("python", "-m", "twine", "check", "--strict", *made)
    (ROOT / "dist").mkdir(exist_ok=True)
    return [Path(shutil.move(path, ROOT / "dist" / path.name)) for path in made]


def tried(place: CleanEnvironment, version: str) -> Iterator[str]:
    """The program where it is installed and nothing else is. Raises NotFitError."""
    for program in (("rig",), ("python", "-m", "rig")):
        _expect(place.run(*program, "--version").stdout.strip(), f"rig {version}")
    yield "rig --version and python -m rig --version"
    file = place.run("python", "-c", EVERYTHING.format(left_out=OF_EXTRAS)).stdout.strip()
    _expect(Path(file).is_relative_to(place.folder.resolve()), True)
    yield "every module but the cluster's is imported without an extra"
    (place.folder / "mine.py").write_text(SCRIPT, encoding="utf-8")
    outcome = json.loads(place.run("rig", "dry-run", "mine.py", "--json").stdout)
    _expect((outcome["complete"], outcome["indentations"]), (True, 2))
    yield "a run of two indentations, with its report"
    run = str(outcome["run"])
    for words in (("runs",), ("show", run), ("watch", run), ("export", run, "--csv"), ("doctor", "--bundle", run)):
        place.run("rig", *words)
    yield "runs, show, watch, export, doctor --bundle"
    refused = place.run("rig", "export", run, "--nwb", code=2)
    _expect(
        refused.stderr.strip(), "rig: export --nwb requires pynwb; install it with pip install 'indentation-rig[nwb]'"
    )
    yield "an extra that is not there is asked for in one line"


def _expect(found: object, expected: object) -> None:
    if found != expected:
        raise NotFitError(f"{found!r}, expected {expected!r}")


if __name__ == "__main__":
    main()
