"""The example of a device from another package: installed into an environment of its own, and pressed with.

The project's build system need not be there and nothing is fetched: tests/device_packages.py makes its wheel, and the
environment borrows the packages of this one.
"""

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from rig.devices.registry import BUILT_IN
from sim.models.fingertip import Fingertip
from tests.device_packages import EXAMPLE, interpreter, scratch, wheel
from tests.program import EMPTY_FIGURES, INIT_ANSWERS, SEVERAL

ROOT = Path(__file__).parents[1]
KINDS = [f"rig.devices.{name}" for names in BUILT_IN.values() for name in names]
COMMAND_LINE = "from rig.cli import main; main()"
PIP = ("--disable-pip-version-check", "install", "--no-index", "--no-deps", "--quiet")
SCRIPT = """\
from rig.protocol import Rig

def run(rig: Rig) -> None:
    rig.mount("step:1")
    rig.home()
    rig.zero()
    rig.move_to(x_mm=0.17)
    rig.indent(force_gwt=2.33, hold_s=0.1)
    rig.indent(doi_mm=0.4, hold_s=0.1)
"""


def _python(folder: Path, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
    state = {"RIG_STATE_DIR": str(folder / "state"), "PYTHONSAFEPATH": "1"}
    return subprocess.run(
        [interpreter(folder / "scratch"), *map(str, arguments)],
        env={name: value for name, value in os.environ.items() if name != "PYTHONPATH"} | state,
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The package in an environment `scratch`, and a script."""
    folder = tmp_path_factory.mktemp("third_party")
    scratch(folder / "scratch", ROOT)
    pip = [sys.executable, "-m", "pip", "--python", str(folder / "scratch"), *PIP, str(wheel(EXAMPLE, folder))]
    done = subprocess.run(pip, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    (folder / "press.py").write_text(SCRIPT, encoding="utf-8")
    return folder


def _rig(folder: Path, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
    return _python(folder, "-c", COMMAND_LINE, *arguments)


def _several(folder: Path, *commands: Sequence[str | Path]) -> list[str]:
    """What commands print that are given one after the other to one Python."""
    words = json.dumps([list(map(str, command)) for command in commands])
    done = _python(folder, "-c", EMPTY_FIGURES + SEVERAL, words)
    assert done.returncode == 0, done.stderr
    return done.stdout.split("\0")[:-1]


def _runs(folder: Path, *forces: str) -> list[Path]:
    for n, force in enumerate(forces):
        (folder / f"{n}.toml").write_text(f"[force]\n{force}", encoding="utf-8")
    commands = [("dry-run", "press.py", "--config", f"{n}.toml", "--json") for n in range(len(forces))]
    return [folder / json.loads(said)["run"] for said in _several(folder, *commands)]


def _holds(run: Path) -> list[dict[str, Any]]:
    documents = map(json.loads, (run / "events.jsonl").read_text(encoding="utf-8").splitlines())
    return [one["data"] for one in documents if one["doc"] == "event" and one["stream"] == "hold_end"]


def test_it_is_pressed_with_like_a_built_in_sensor(folder: Path, finger: Fingertip) -> None:
    """Both show 0.01 g of the same finger: at rest the same steps give the same counts."""
    own, built_in = _runs(folder, 'kind = "line_scale"\n[force.line_scale]\naddress = 7\n', 'kind = "mtsics"\n')
    for ours, theirs in zip(_holds(own), _holds(built_in), strict=True):
        assert ours["force_gwt"] == pytest.approx(theirs["force_gwt"], abs=1e-9)
        assert ours["true_doi_mm"] == pytest.approx(theirs["true_doi_mm"], abs=1e-9)
    assert len(_holds(own)) == 2
    chunks = map(json.loads, (own / "bytes.jsonl").read_text(encoding="utf-8").splitlines())
    sent = b"".join(bytes.fromhex(one["hex"]) for one in chunks if one["port"] == "force" and one["dir"] == "tx")
    assert set(sent.split(b"\r")) == {b"#07I", b"#07W", b"#07Z", b""}
    assert json.loads((own / "provenance.json").read_text("utf-8"))["devices"]["force"].endswith("line_scale")


def test_it_is_installed_there_and_nowhere_else(folder: Path) -> None:
    code = "import rig_line_scale, sys; print(rig_line_scale.__file__, sys.prefix)"
    file, prefix = _python(folder, "-c", code).stdout.split()
    assert Path(file).is_relative_to(folder / "scratch")
    assert Path(prefix) == folder / "scratch"
    ours = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=False)
    assert "ModuleNotFoundError" in ours.stderr


def test_doctor_and_serve_know_it(folder: Path) -> None:
    told, help_, known = _several(
        folder, ("doctor", "--json"), ("serve", "--help"), ("config", "--devices", "--json")
    )
    assert json.loads(told)["devices"][-1] == {
        "kind": "line_scale",
        "role": "force",
        "package": "rig-line-scale 0.1.0",
    }
    assert "line_scale" in help_
    catalogued = json.loads(known)["devices"][-1]
    assert (catalogued["kind"], catalogued["package"]) == ("line_scale", "rig-line-scale 0.1.0")
    assert (bool(catalogued["manual_text"]), catalogued["hardware_text"], catalogued["measured"]) == (True, None, [])
    refused = _rig(folder, "serve", "--force", "scale")
    assert refused.returncode == 2
    assert "mtsics, laumas, text_cell, net_ft or line_scale" in refused.stderr


def test_init_offers_it_and_takes_it_without_a_probe(folder: Path) -> None:
    ports = ("--stage", "grbl", "--stage-port", "nowhere0", "--sensor-port", "nowhere1")
    refused = _rig(folder, "init", "--sensor", "scale", *ports, *INIT_ANSWERS)
    assert (refused.returncode, "mtsics, laumas, text_cell, net_ft or line_scale" in refused.stderr) == (2, True)
    written = _rig(folder, "init", "--yes", "--to", "found.toml", "--sensor", "line_scale", *ports, *INIT_ANSWERS)
    assert written.returncode == 0, written.stderr
    assert 'kind = "line_scale"' in (folder / "found.toml").read_text(encoding="utf-8")


def test_nothing_is_imported_but_the_kinds_that_are_used(folder: Path) -> None:
    """A stage's, for its outputs; no sensor's, no package's, and no other stage's."""
    code = "import sys; from rig.plan.config import Config; Config(); print(*sys.modules)"
    told = _python(folder, "-c", code).stdout.split()
    assert [name for name in told if name in KINDS] == ["rig.devices.grbl"]
    assert not [name for name in told if name.startswith("rig_line_scale")]


def test_its_own_tests_pass(folder: Path) -> None:
    options = ("-q", "-p", "no:cacheprovider", "--import-mode=importlib", "-c", os.devnull)
    done = _python(folder, "-m", "pytest", *options, EXAMPLE / "tests")
    assert done.returncode == 0, done.stdout
    assert "21 passed" in done.stdout
