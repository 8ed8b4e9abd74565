"""What a release must be: one version everywhere, metadata, a program by either name, extras that are extra.

`make release-check` builds and installs it, which takes the network; here is what can be said without.
"""

import subprocess
import sys
import tomllib
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest

import studies.release_check as release

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


def test_package_citation_and_changelog_state_one_version(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert release.stated_version() == _project()["version"] == version("indentation-rig")
    for name in ("pyproject.toml", "CITATION.cff", "CHANGELOG.md"):
        (tmp_path / name).write_bytes((ROOT / name).read_bytes())
    monkeypatch.setattr(release, "ROOT", tmp_path)
    assert release.stated_version() == _project()["version"]
    for name, text in {"CHANGELOG.md": "## 0.0.9\n", "CITATION.cff": "cff-version: 1.2.0\n"}.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
        with pytest.raises(release.NotFitError, match=f"{name}: expected version {_project()['version']}"):
            release.stated_version()


def test_python_m_rig_runs_the_program_with_its_exit_code() -> None:
    def run(*words: str) -> tuple[int, str, str]:
        done = subprocess.run([sys.executable, "-m", "rig", *words], capture_output=True, text=True, check=False)
        return done.returncode, done.stdout, done.stderr

    assert run("--version") == (0, f"rig {version('indentation-rig')}\n", "")
    assert run("config", "ß")[0] == 2


def test_every_module_can_be_imported_without_optional_packages() -> None:
    """And then one that needs an extra."""
    code = WITHOUT + release.EVERYTHING.format(left_out=release.OF_EXTRAS) + f"import {release.OF_EXTRAS[0]}"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stdout.strip() == str(ROOT / "rig" / "__init__.py"), done.stderr
    assert "ModuleNotFoundError: distributed" in done.stderr
