"""What a release must be: one version everywhere, metadata, a program by either name, extras that are extra.

`make release-check` builds and installs it, which takes the network; here is what can be said without.
"""

import re
import subprocess
import sys
import tomllib
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest

import studies.release_check as release
from tests.program import Program

ROOT = Path(__file__).parents[2]
EXTRAS = {
    *("pynwb", "hdmf", "pypardiso", "distributed", "dask", "pandas", "xarray", "nwbinspector", "skfem", "pytest"),
}
WITHOUT = f"""\
import sys

class Missing:
    @staticmethod
    def find_spec(name, path=None, target=None):
        if name.partition(".")[0] in {EXTRAS!r}:
            raise ModuleNotFoundError(name)

sys.meta_path.insert(0, Missing)
"""


def _project() -> Any:
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def test_one_version_everywhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert release.stated_version() == _project()["version"] == version("indentation-rig")
    for name in ("pyproject.toml", "CITATION.cff", "CHANGELOG.md"):
        (tmp_path / name).write_bytes((ROOT / name).read_bytes())
    monkeypatch.setattr(release, "ROOT", tmp_path)
    assert release.stated_version() == _project()["version"]
    for name, text in {"CHANGELOG.md": "## 0.0.9\n", "CITATION.cff": "cff-version: 1.2.0\n"}.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
        with pytest.raises(release.NotFitError, match=f"{name}: expected version {_project()['version']}"):
            release.stated_version()


def test_what_is_said_of_the_package() -> None:
    told = _project()
    assert told["authors"]
    assert told["keywords"]
    assert {"Programming Language :: Python :: 3.11", "Typing :: Typed"} <= set(told["classifiers"])
    assert not [one for one in told["classifiers"] if one.startswith("License ::")]  # the expression says it
    assert (ROOT / told["readme"]).is_file()
    assert all((ROOT / name).is_file() for name in told["license-files"])


def test_the_panel_needs_no_extra() -> None:
    """Its packages are ordinary dependencies."""
    told = _project()
    packages = {re.split("[<>=]", one)[0] for one in told["dependencies"]}
    assert packages >= {"starlette", "uvicorn"}


def test_the_program_says_which_it_is(program: Program) -> None:
    ended = program("--version")
    assert (ended.code, ended.out, ended.err) == (0, f"rig {version('indentation-rig')}\n", "")


def test_python_runs_the_package_and_ends_as_the_program_does() -> None:
    def run(*words: str) -> tuple[int, str, str]:
        done = subprocess.run([sys.executable, "-m", "rig", *words], capture_output=True, text=True, check=False)
        return done.returncode, done.stdout, done.stderr

    assert run("--version") == (0, f"rig {version('indentation-rig')}\n", "")
    assert run("config", "ß")[0] == 2


def test_every_module_is_imported_without_an_extra() -> None:
    """And then one that needs an extra."""
    code = WITHOUT + release.EVERYTHING.format(left_out=release.OF_EXTRAS) + f"import {release.OF_EXTRAS[0]}"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stdout.strip() == str(ROOT / "rig" / "__init__.py"), done.stderr
    assert "ModuleNotFoundError: distributed" in done.stderr


def test_a_check_that_fails_is_told_and_ends_with_one(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def failing() -> Any:
        yield "this much"
        release._expect(1, 2)

    monkeypatch.setattr(release, "checks", failing)
    with pytest.raises(SystemExit, match="not fit to be released: 1, expected 2"):
        release.main()
    assert capsys.readouterr().out == "this much\n"
    monkeypatch.setattr(release, "checks", lambda: iter(["all of it"]))
    release.main()
    assert capsys.readouterr().out == "all of it\nfit to be released\n"
