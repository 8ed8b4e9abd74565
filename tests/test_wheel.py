"""What a user installs: `rig`, `sim` and `rig_shared` of a wheel, which need nothing of the repository.

`setup.py` builds the packages, which are laid out as an installer does.
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
GALLERY = ROOT / "examples" / "gallery" / "library" / "01_press_and_plot.py"
CODE = """\
import runpy, sys
import sim, rig
from rig.cli import main
from rig.protocol.script import load_script

print(sim.__file__, rig.__file__, load_script("steps", []).path)
print(sim.load("section"))
runpy.run_path(sys.argv[1], run_name="__main__")
sys.argv = ["rig", "config", "--devices", "--json"]
main()
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what `setup.py` builds."""
    folder = tmp_path_factory.mktemp("wheel")
    site = folder / "site"
    options = ("egg_info", "--egg-base", folder, "build", "--build-base", folder / "build", "--build-lib", site)
    subprocess.run([sys.executable, "setup.py", "-q", *map(str, options)], cwd=ROOT, check=True)
    about = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    for path, text in dist_info(about["name"], about["version"], {}).items():
        (site / path).parent.mkdir(parents=True, exist_ok=True)
        (site / path).write_text(text, encoding="utf-8")
    bring_loops(site)
    return site


def _files(folder: Path) -> set[str]:
    return {
        path.relative_to(folder).as_posix()
        for path in folder.rglob("*")
        if path.is_file() and path.suffix != ".pyc" and path.parent.name != "__pycache__"
    }


@pytest.mark.parametrize(
    ("source", "inside"),
    [
        ("rig", "rig"),
        ("rig_shared", "rig_shared"),
        ("sim", "sim"),
        ("protocols", "rig/shipped_protocols"),
        ("examples/human_finger", "rig/shipped_fingers/human_finger"),
    ],
)
def test_every_file_is_in_the_wheel(site: Path, source: str, inside: str) -> None:
    assert _files(ROOT / source) - _files(site / inside) == set()


@pytest.fixture(scope="module")
def printed(site: Path) -> list[str]:
    """What a Python prints that finds our packages there only."""
    place = {"PYTHONPATH": str(site), "PYTHONSAFEPATH": "1", "MPLBACKEND": "agg"}
    done = subprocess.run([sys.executable, "-c", CODE, str(GALLERY)], env={**os.environ, **place}, cwd=site.parent,
                          capture_output=True, text=True, check=True)  # fmt: skip
    return done.stdout.splitlines()


def test_the_wheel_contains_data_types_and_command_line(site: Path, printed: list[str]) -> None:
    files, section, *_, devices = printed
    script = site / "rig" / "shipped_protocols" / "steps.py"
    assert files == f"{site / 'sim' / '__init__.py'} {site / 'rig' / '__init__.py'} {script}"
    assert section == "<Fingertip section, FingertipConfig()>"
    assert json.loads(devices)["devices"][0]["measured"], "the numbers are in the package"
    assert (site / "sim" / "py.typed").exists()


def test_a_gallery_script_runs_from_the_wheel(printed: list[str]) -> None:
    assert printed[2].startswith("4.7")
    assert " gwt, contact from x = -" in printed[2]
