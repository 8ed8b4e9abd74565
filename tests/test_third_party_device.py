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
from tests.program import EMPTY_FIGURES, INIT_ANSWERS

ROOT = Path(__file__).parents[1]
KINDS = [f"rig.devices.{name}" for names in BUILT_IN.values() for name in names]
OFFERED = f"{', '.join(BUILT_IN['force'])} or line_scale"
SEVERAL = """\
import contextlib, io, json, sys
from rig.cli import main

ended = []
for words in json.loads(sys.argv[1]):
    sys.argv[1:] = words
    out, err, code = io.StringIO(), io.StringIO(), 0
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            main()
        except SystemExit as exit:
            code = exit.code or 0
    ended.append((code, out.getvalue(), err.getvalue()))
print(json.dumps(ended))
"""
"""Commands as JSON, carried out one after the other; how each ended, and what it printed."""

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


@pytest.fixture(scope="module")
def ended(folder: Path, finger: Fingertip) -> dict[str, tuple[int, str, str]]:
    """How commands end there, by name: exit code, standard output, standard error."""
    (folder / "own.toml").write_text('[force]\nkind = "line_scale"\n[force.line_scale]\naddress = 7\n', "utf-8")
    (folder / "built_in.toml").write_text('[force]\nkind = "mtsics"\n', encoding="utf-8")
    ports = ("--stage", "grbl", "--stage-port", "nowhere0", "--sensor-port", "nowhere1", *INIT_ANSWERS)
    commands: dict[str, Sequence[str]] = {
        "own": ("dry-run", "press.py", "--config", "own.toml", "--json"),
        "built in": ("dry-run", "press.py", "--config", "built_in.toml", "--json"),
        "doctor": ("doctor", "--json"),
        "help": ("serve", "--help"),
        "devices": ("config", "--devices", "--json"),
        "serve": ("serve", "--force-sensor", "scale"),
        "init": ("init", "--sensor", "scale", *ports),
        "written": ("init", "--yes", "--to", "found.toml", "--sensor", "line_scale", *ports),
    }
    done = _python(folder, "-c", EMPTY_FIGURES + SEVERAL, json.dumps(list(commands.values())))
    assert done.returncode == 0, done.stderr
    return dict(zip(commands, json.loads(done.stdout), strict=True))


def _holds(run: Path) -> list[dict[str, Any]]:
    documents = map(json.loads, (run / "events.jsonl").read_text(encoding="utf-8").splitlines())
    return [one["data"] for one in documents if one["doc"] == "event" and one["stream"] == "hold_end"]


def test_a_sensor_of_a_package_presses_like_a_built_in_one(
    folder: Path, ended: dict[str, tuple[int, str, str]]
) -> None:
    """Both show 0.01 g of the same finger: at rest the same steps give the same counts."""
    own, built_in = (folder / json.loads(ended[name][1])["run"] for name in ("own", "built in"))
    for ours, theirs in zip(_holds(own), _holds(built_in), strict=True):
        assert ours["force_gwt"] == pytest.approx(theirs["force_gwt"], abs=1e-9)
        assert ours["true_doi_mm"] == pytest.approx(theirs["true_doi_mm"], abs=1e-9)
    assert len(_holds(own)) == 2
    chunks = map(json.loads, (own / "bytes.jsonl").read_text(encoding="utf-8").splitlines())
    sent = b"".join(bytes.fromhex(one["hex"]) for one in chunks if one["port"] == "force" and one["dir"] == "tx")
    assert set(sent.split(b"\r")) == {b"#07I", b"#07W", b"#07Z", b""}
    assert json.loads((own / "provenance.json").read_text("utf-8"))["devices"]["force"].endswith("line_scale")


def test_commands_offer_the_device_of_a_package(folder: Path, ended: dict[str, tuple[int, str, str]]) -> None:
    assert {name: code for name, (code, _, _) in ended.items() if code} == {"serve": 2, "init": 2}
    assert json.loads(ended["doctor"][1])["devices"][-1] == {
        "kind": "line_scale",
        "role": "force",
        "package": "rig-line-scale 0.1.0",
    }
    assert "line_scale" in ended["help"][1]
    catalogued = json.loads(ended["devices"][1])["devices"][-1]
    assert (catalogued["kind"], catalogued["package"]) == ("line_scale", "rig-line-scale 0.1.0")
    assert (bool(catalogued["manual_text"]), catalogued["hardware_text"], catalogued["measured"]) == (True, None, [])
    assert OFFERED in ended["serve"][2]
    assert OFFERED in ended["init"][2]
    assert 'kind = "line_scale"' in (folder / "found.toml").read_text(encoding="utf-8")  # without a probe


def test_a_device_package_is_imported_only_where_it_is_used(folder: Path) -> None:
    """Of the kinds: a stage, for its outputs; no sensor, no package, and no other stage."""
    used = "import sys; from rig.plan.config import Config; Config(); print(*sys.modules)\n"
    code = "import rig_line_scale, sys; print(rig_line_scale.__file__, sys.prefix)"
    modules, place = _python(folder, "-c", used + code).stdout.splitlines()
    assert [name for name in modules.split() if name in KINDS] == ["rig.devices.grbl"]
    assert not [name for name in modules.split() if name.startswith("rig_line_scale")]
    file, prefix = place.split()
    assert Path(file).is_relative_to(folder / "scratch")
    assert Path(prefix) == folder / "scratch"
    ours = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=False)
    assert "ModuleNotFoundError" in ours.stderr


def test_the_tests_of_the_example_device_package_pass(folder: Path) -> None:
    options = ("-q", "-p", "no:cacheprovider", "--import-mode=importlib", "-c", os.devnull)
    done = _python(folder, "-m", "pytest", *options, EXAMPLE / "tests")
    assert done.returncode == 0, done.stdout
    assert "21 passed" in done.stdout
