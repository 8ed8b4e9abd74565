"""What a user installs: `rig`, `sim` and `rig_shared` of a wheel, which need nothing of the repository.

Its files are what `pyproject.toml` says belongs in it, laid out as an installer does, without the build system.
"""

import json
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from tests.device_packages import dist_info
from tests.kept_loops import bring_loops

ROOT = Path(__file__).parents[1]
CODE = """\
import sys
import sim, rig
from rig.cli import main
from rig.protocol.script import load_script

print(sim.__file__, rig.__file__, load_script("steps", []).path)
print(sim.load("section"))
sys.argv = ["rig", "config", "--devices", "--json"]
main()
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the wheel installed."""
    site = tmp_path_factory.mktemp("wheel") / "site"
    told = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    about, target = told["project"], told["tool"]["hatch"]["build"]["targets"]["wheel"]
    places = {name: name for name in target["packages"]} | target["force-include"]
    files = {
        (Path(inside) / path.relative_to(ROOT / outside)).as_posix(): path.read_bytes()
        for outside, inside in places.items()
        for path in sorted([ROOT / outside, *(ROOT / outside).rglob("*")])
        if path.is_file() and "__pycache__" not in path.parts
    }
    files |= {path: text.encode() for path, text in dist_info(about["name"], about["version"], {}).items()}
    for path, content in files.items():
        (site / path).parent.mkdir(parents=True, exist_ok=True)
        (site / path).write_bytes(content)
    bring_loops(site)
    return site


def _python(site: Path, *arguments: str | Path) -> str:
    """What Python prints that finds our packages there only."""
    place = {"PYTHONPATH": str(site), "PYTHONSAFEPATH": "1", "MPLBACKEND": "agg"}
    done = subprocess.run([sys.executable, *map(str, arguments)], env={**os.environ, **place}, cwd=site.parent,
                          capture_output=True, text=True, check=True)  # fmt: skip
    return done.stdout


def test_it_is_found_there_with_its_data_types_and_command_line(site: Path) -> None:
    files, section, devices = _python(site, "-c", CODE).splitlines()
    script = site / "rig" / "shipped_protocols" / "steps.py"
    assert files == f"{site / 'sim' / '__init__.py'} {site / 'rig' / '__init__.py'} {script}"
    assert section == "<Fingertip section, FingertipConfig()>"
    assert json.loads(devices)["devices"][0]["measured"], "the numbers are in the package"
    assert (site / "sim" / "py.typed").exists()


def test_an_example_runs_there(site: Path) -> None:
    said = _python(site, ROOT / "examples" / "gallery" / "library" / "01_press_and_plot.py")
    assert said.startswith("4.7")
    assert " gwt, contact from x = -" in said
