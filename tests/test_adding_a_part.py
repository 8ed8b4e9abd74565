"""docs/code_overview.md says where a new part goes: one of each is added there, in no other file, and used.

Parts of the rig are in one copy of the program, those of the simulator in another: what changes there changes the
hash of a model's code, and the default finger would be built again.
"""

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

import pytest

from sim.models.catalogue import load
from sim.models.fingertip import Fingertip
from tests.kept_loops import bring_loops
from tests.parts import insertions
from tests.program import SEVERAL

ROOT = Path(__file__).parents[1]
PARTS = ROOT / "tests" / "parts"
OLD_RUN = ROOT / "tests" / "data" / "runs" / "complete"
PLACES = ("rig", "sim", "rig_shared", "protocols")
PRESS = ("--x-mm", "0", "--doi-mm", "0.2")
DEVICES = '[stage]\nkind = "hobby"\n[force]\nkind = "plain"\n[force.plain]\ndecimals = 2\n'
NO_MAPS = "import rig.cli.compare; rig.cli.compare.stimulus_maps = lambda *_: []\n"  # a factorization, seconds
SCRIPT = """\
from rig.protocol import ProtocolParameters, Rig

METADATA = {"title": "Two light presses"}


class Parameters(ProtocolParameters):
    taps: bool = False


def run(rig: Rig) -> None:
    rig.mount("bar:3.0")
    rig.home()
    rig.zero()
    rig.move_to(x_mm=0.0)
    for times in (2, 3):
        if rig.parameters.taps:
            rig.tap(times=times)
        rig.indent(doi_mm=0.1, hold_s=0.1)
"""


def _rows() -> dict[str, list[str]]:
    """The files of each line of the table, NAME and all."""
    page = (ROOT / "docs" / "code_overview.md").read_text(encoding="utf-8")
    table = page.partition("\n## Adding a part\n")[2].partition("\n## ")[0]
    lines = [line.strip("| ").split(" | ", 1) for line in table.splitlines() if line.startswith("| ")]
    return {part: re.findall(r"`((?:rig|sim)/[\w/*]+\.py)`", files) for part, files in lines}


class Tree:
    """A copy of the program that a part is added to."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        for place in PLACES:
            shutil.copytree(ROOT / place, folder / place, ignore=shutil.ignore_patterns("loops-*"))
        bring_loops(folder)

    def add(self, part: str, name: str, made: dict[str, str], inserted: Sequence[tuple[str, str, str]]) -> None:
        """Write files (from tests/parts) and insert text before anchors; all is where the page says, and no more."""
        for path, text in made.items():
            assert not (self.folder / path).exists(), path
            (self.folder / path).parent.mkdir(exist_ok=True)
            shutil.copy(PARTS / text, self.folder / path)
        for path, anchor, text in inserted:
            before = (self.folder / path).read_text(encoding="utf-8")
            assert before.count(anchor) == 1, f"{path}: {anchor!r} {before.count(anchor)} times"
            (self.folder / path).write_text(before.replace(anchor, text + anchor), encoding="utf-8")
        named = [path.replace("NAME", name) for path in _rows()[part]]
        touched = {*made, *(path for path, _, _ in inserted)}
        assert touched
        assert not [path for path in touched if not any(fnmatch(path, one) for one in named)], "not on the page"
        assert not [one for one in named if not any(fnmatch(path, one) for path in touched)], "not needed"

    def python(self, code: str, *arguments: str | Path) -> str:
        """What a Python of its own prints."""
        done = subprocess.run(
            [sys.executable, "-c", code, *map(str, arguments)],
            env={**os.environ, "PYTHONPATH": str(self.folder), "PYTHONSAFEPATH": "1"},
            cwd=self.folder,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    def several(self, *commands: Sequence[str | Path], before: str = "", after: str = "") -> list[str]:
        """What commands print that are given one after the other to one Python, and then what `after` prints."""
        words = [list(map(str, command)) for command in commands]
        return self.python(f"{before}{SEVERAL}{after}", json.dumps(words)).split("\0")[: len(words) + bool(after)]


def _events(run: Path, stream: str) -> list[dict[str, Any]]:
    documents = map(json.loads, (run / "events.jsonl").read_text(encoding="utf-8").splitlines())
    return [one["data"] for one in documents if one["doc"] == "event" and one["stream"] == stream]


def _lasted_s(run: Path) -> float:
    return float(json.loads((run / "events.jsonl").read_text(encoding="utf-8").splitlines()[-1])["t_s"])


def _sent(run: Path, port: str) -> bytes:
    chunks = map(json.loads, (run / "bytes.jsonl").read_text(encoding="utf-8").splitlines())
    return b"".join(bytes.fromhex(one["hex"]) for one in chunks if one["port"] == port and one["dir"] == "tx")


def _cut(run: Path, last: Callable[[dict[str, Any]], bool]) -> None:
    """As a kill leaves it."""
    lines = (run / "events.jsonl").read_text(encoding="utf-8").splitlines(keepends=True)
    end = next(n for n, line in enumerate(lines) if last(json.loads(line)))
    (run / "events.jsonl").write_text("".join(lines[: end + 1]), encoding="utf-8")


# --- parts of the rig ---


@dataclass(frozen=True)
class Used:
    """A run of the script on the new devices, and what commands printed that were carried out behind it."""

    tree: Tree
    run: Path
    checked: dict[str, Any]
    help_of_serve: str
    help_of_holds: str
    holds: dict[str, Any]


@pytest.fixture(scope="module")
def used(tmp_path_factory: pytest.TempPathFactory, finger: Fingertip) -> Used:
    tree = Tree(tmp_path_factory.mktemp("rig"))
    tree.add("verb", "tap", {}, insertions.VERB)
    stage = {"rig/devices/hobby.py": "hobby_driver.py", "sim/devices/hobby.py": "hobby_twin.py"}
    force = {"rig/devices/plain.py": "plain_driver.py", "sim/devices/plain.py": "plain_twin.py"}
    tree.add("stage", "hobby", stage, insertions.STAGE)
    tree.add("force sensor", "plain", force, insertions.FORCE)
    tree.add("command", "holds", {"rig/cli/holds.py": "holds_command.py"}, insertions.COMMAND)
    tree.add("figure of the run's report", "", {}, insertions.RUN_SECTION)
    tree.add("figure of the comparison's report", "", {}, insertions.COMPARISON_SECTION)
    (tree.folder / "light.py").write_text(SCRIPT, encoding="utf-8")
    (tree.folder / "rig.toml").write_text(DEVICES, encoding="utf-8")
    how = ("light.py", "--set", "taps=true", "--config", "rig.toml", "--json")
    said, checked, help_of_serve, help_of_holds, holds, _ = tree.several(
        ("dry-run", *how, "--out", "runs"),
        ("check", *how),
        ("serve", "--help"),
        ("holds", "--help"),
        ("holds", OLD_RUN, "--json"),
        ("compare", OLD_RUN, "--out", "page.html", "--json"),
        before=NO_MAPS,
    )
    run = tree.folder / json.loads(said)["run"]
    return Used(tree, run, json.loads(checked), help_of_serve, help_of_holds, json.loads(holds))


def test_a_stage_and_a_force_sensor(used: Used) -> None:
    """Each is a driver, its twin and an entry of the registry, and nothing else."""
    assert {path for path, _, _ in (*insertions.STAGE, *insertions.FORCE)} == {"rig/devices/registry.py"}
    assert [event["controller"] for event in _events(used.run, "home")] == ["[VER:1.1h.hobby:]"]
    assert "hobby" in json.loads((used.run / "provenance.json").read_text(encoding="utf-8"))["devices"]["stage"]
    assert set(_sent(used.run, "force").split()) == {b"W", b"Z"}
    assert [hold["doi_mm"] for hold in _events(used.run, "hold_end")] == pytest.approx([0.1, 0.1], abs=0.02)
    assert "plain" in used.help_of_serve


def test_a_command(used: Used) -> None:
    assert "what force was held" in used.help_of_holds
    forces = used.holds["force_gwt"]
    assert forces == [hold["force_gwt"] for hold in _events(OLD_RUN, "hold_end")]
    assert len(forces) == 5


def test_a_section_of_a_report(used: Used) -> None:
    """Of a run, and of a comparison."""
    page = (used.run / "report.html").read_text(encoding="utf-8")
    assert re.findall(r"<h2[^>]*>(F.*)</h2>", page) == ["Force against time", "Force against depth", "Final depths"]
    page = (used.tree.folder / "page.html").read_text(encoding="utf-8")
    assert re.search(r"<h2[^>]*>Depths: bar:3.0 at 0.4 mm</h2>", page)


def test_a_verb(used: Used) -> None:
    """It is planned, checked, rehearsed, carried out, journalled, and owed by a run that is taken up again."""
    assert used.checked["indentations"] == 2
    assert used.checked["duration_s"] == pytest.approx(_lasted_s(used.run), rel=0.02)
    assert [event["times"] for event in _events(used.run, "tap")] == [2, 3]
    assert len(_events(used.run, "find")) == 5
    again = used.tree.folder / "again"
    shutil.copytree(used.run, again)
    _cut(
        again,
        lambda one: one["doc"] == "event" and one["stream"] == "indentation_start" and one["data"]["index"] == 1,
    )
    used.tree.several(("resume", again, "--json"))
    assert [event["times"] for event in _events(again, "tap")] == [2, 3, 3]


# --- parts of the simulator ---


@pytest.mark.study  # the other tests, sim/test_indentors.py, sim/test_whole_profiles.py
def test_a_shape_a_measure_and_a_model(tmp_path: Path) -> None:
    """A circle is its parabola where contact is narrow beside its radius."""
    tree = Tree(tmp_path)
    tree.add("shape", "parabola", {}, insertions.SHAPE)
    tree.add("measure", "gmax", {}, insertions.MEASURE)
    tree.add("model", "soft", {"sim/models/soft.py": "soft_model.py"}, insertions.MODEL)
    commands = [
        ("indent", "--shape", shape, *PRESS, "--model", model, "--json")
        for shape, model in (("parabola:4.5", "halfspace"), ("bar:3.0", "halfspace"), ("cylinder:9", "soft"))
    ]
    units = "from rig.report.style import *; print(unit('gmax'), unit('s11'))"
    *said, help_, named = tree.several(*commands, ("indent", "--help"), after=units)
    parabola, bar, soft = map(json.loads, said)
    circle = load("halfspace").indent("cylinder:9", 0.0, doi_mm=0.2).force_n
    assert parabola["force_n"] == pytest.approx(circle, rel=0.02)
    assert parabola["force_n"] != circle
    strains = zip(bar["receptors"]["ep3"], bar["receptors"]["ep1"], strict=True)
    assert bar["receptors"]["gmax"] == pytest.approx([high - low for high, low in strains])
    assert named.split() == ["strain", "pseudo-units"]
    assert (soft["solver"]["model"], soft["force_n"]) == ("soft", pytest.approx(0.5 * circle, rel=1e-6))
    assert "soft" in help_
