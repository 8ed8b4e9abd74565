"""What a user installs: a wheel with `rig`, `sim` and `rig_shared` that needs nothing of the repository.

tests/device_packages.py makes it from what `pyproject.toml` says belongs in it, without the build system.
"""

import json
import os
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

from tests.device_packages import dist_info
from tests.kept_loops import bring_loops

ROOT = Path(__file__).parents[1]
PIP = ("-m", "pip", "--disable-pip-version-check", "install", "--no-index", "--no-deps", "--quiet")


def _wheel(folder: Path) -> Path:
    told = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    about, target = told["project"], told["tool"]["hatch"]["build"]["targets"]["wheel"]
    places = {name: name for name in target["packages"]} | target["force-include"]
    files = {
        (Path(inside) / path.relative_to(ROOT / outside)).as_posix(): path.read_bytes()
        for outside, inside in places.items()
        for path in sorted([ROOT / outside, *(ROOT / outside).rglob("*")])
        if path.is_file() and "__pycache__" not in path.parts
    }
    known = dist_info(about["name"], about["version"], {})
    record = next(iter(known)).replace("METADATA", "RECORD")
    files |= {path: text.encode() for path, text in known.items()}
    files[record] = "".join(f"{path},,\n" for path in (*files, record)).encode()
    made = folder / f"{about['name'].replace('-', '_')}-{about['version']}-py3-none-any.whl"
    with zipfile.ZipFile(made, "w") as archive:
        for path, content in files.items():
            archive.writestr(path, content)
    return made


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the wheel installed."""
    folder = tmp_path_factory.mktemp("wheel")
    site = folder / "site"
    subprocess.run([sys.executable, *PIP, "--target", site, _wheel(folder)], check=True, cwd=folder)
    bring_loops(site)
    return site


def _python(site: Path, *arguments: str | Path) -> str:
    """What Python prints that finds our packages there only."""
    place = {"PYTHONPATH": str(site), "PYTHONSAFEPATH": "1", "MPLBACKEND": "agg"}
    done = subprocess.run([sys.executable, *map(str, arguments)], env={**os.environ, **place}, cwd=site.parent,
                          capture_output=True, text=True, check=True)  # fmt: skip
    return done.stdout


def test_it_is_found_there_with_its_data_and_types(site: Path) -> None:
    code = "import sim, rig; print(sim.__file__, rig.__file__); print(sim.load('section'))"
    files, section = _python(site, "-c", code).splitlines()
    assert files == f"{site / 'sim' / '__init__.py'} {site / 'rig' / '__init__.py'}"
    assert section == "<Fingertip section, FingertipConfig()>"
    assert (site / "sim" / "py.typed").exists()
    assert (site / "rig" / "shipped_protocols" / "steps.py").exists()


def test_an_example_runs_there(site: Path) -> None:
    said = _python(site, ROOT / "examples" / "gallery" / "library" / "01_press_and_plot.py")
    assert said.startswith("4.7")
    assert " gwt, contact from x = -" in said


def test_the_command_line_and_its_scripts_are_there(site: Path) -> None:
    assert "Usage: rig check" in _python(site, "-c", "from rig.cli import main; main()", "check", "--help")
    devices = _python(site, "-c", "from rig.cli import main; main()", "config", "--devices", "--json")
    assert json.loads(devices)["devices"][0]["measured"], "the numbers are in the package"
    code = "from rig.protocol.script import load_script; print(load_script('steps', []).path)"
    assert _python(site, "-c", code).strip() == str(site / "rig" / "shipped_protocols" / "steps.py")
