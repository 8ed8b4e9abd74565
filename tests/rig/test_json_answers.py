"""What commands answer with --json is as their schema says; `FROZEN=write` writes the examples of the documentation.

tests/rig/real_time asks the commands at the bench, test_identification asks identify: whatever a test reads as JSON
is held against the schema of its command (tests/program.py).
"""

import json
import os
import shutil
from collections.abc import Iterator, Mapping
from inspect import signature
from pathlib import Path
from typing import Any

import pytest

from rig.cli.json_schema import OUTPUTS, schema_of_command
from rig.cli.output import one_line_errors, print_json
from rig.cli.program import COMMANDS
from rig_shared.outputs import FORMATS, SUFFIXES, UNIT_FIELDS
from sim.benchmark import QUICK_SCENES, Candidate, coarse
from tests.program import Program, as_in_its_schema, functions
from tests.sim.coarse_mesh import as_toml, coarse_mesh

ROOT = Path(__file__).parents[2]
OLD_RUNS = ROOT / "tests" / "data" / "runs"
WRITES = os.environ.get("FROZEN") == "write"
SCRIPT = "def run(rig):\n    rig.mount('bar:3.0')\n    rig.home()\n    rig.zero()\n    rig.move_to(x_mm=0.0)\n"
COARSE = ("--config", "coarse.toml")
ASKED = (
    ("dry-run mine.py", ""),
    ("dry-run nowhere.py", "that is refused"),
    ("check mine.py", ""),
    ("resume runs/stopped", ""),
    ("show runs/complete", ""),
    ("show runs/stopped", "of a stopped run"),
    ("show --columns", "of columns"),
    ("runs runs", ""),
    ("watch runs/complete", ""),
    ("export runs/complete --csv", ""),
    ("nerve runs/complete --afferents SA1@0", ""),
    ("compare runs/complete --recorded bar:3.0=recorded.csv", ""),
    ("compare runs/complete --recorded afferents.csv", "of several afferents"),
    ("config limits", ""),
    ("config --devices", "of devices"),
    ("doctor", ""),
    ("doctor --bundle runs/complete", "as a bundle"),
    ("cache", ""),
    ("bench --quick --out bench.html", ""),
    ("indent --shape bar:3.0 --x-mm 0 --doi-mm 0.3", ""),
    ("indent --shape bar:3.0 --x-mm 0 --doi-mm 0.3 --model auto", "of a model that was chosen"),
    ("indent --shape bar:3.0 --x-mm 0 --doi-mm 0.3 --other-paths", "by several ways"),
    ("encode --pressure 20,14 --half-length 8", ""),
    ("encode --shape cylinder:3 --doi-mm 0.4 --operator influence --half-length 8", "of a press"),
    ("decode --pressure 20,14 --half-length 10", ""),
    ("impulse --half-length 8", ""),
    ("shift-invariance --spacing-mm 0.5 --half-width-mm 2", ""),
    ("find found/*", ""),
    ("finger", ""),
    ("study study.toml --processes 1", ""),
)
FOUND = "dry-run find_finger across=5 along=1 --out found"
ON_A_COARSE_FINGER = ("encode", "decode", "impulse", "shift-invariance")


EXAMPLES = ROOT / "docs" / "json_examples"


def _short(value: Any) -> Any:
    """An answer for the documentation: the first items of a list, six digits of a number."""
    if isinstance(value, Mapping):
        return {key: _short(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [_short(inner) for inner in value[:2]]
    return float(f"{value:.6g}") if isinstance(value, float) else value


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, empty_figures: None, cheap_measures: None) -> Path:
    """A script, a recording, two runs, a coarse finger and a study, in the folder where commands are asked."""
    monkeypatch.chdir(tmp_path)
    for name in ("complete", "stopped"):
        shutil.copytree(OLD_RUNS / name, tmp_path / "runs" / name)
    shutil.copy(OLD_RUNS / "recorded.csv", tmp_path)
    shutil.copy(OLD_RUNS / "recorded.csv", tmp_path / "another.csv")
    study = '[[press]]\nshape = "bar:3.0"\ndoi_mm = [0.2]\n'
    texts = {
        "afferents.csv": "afferent,shape,file\na,bar:3.0,recorded.csv\nb,bar:3.0,another.csv\n",
        "mine.py": f"{SCRIPT}    rig.indent(doi_mm=0.3)\n",
        "study.toml": study,
        "coarse.toml": as_toml(coarse_mesh(0.5, 0.5)),
    }
    for name, text in texts.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    monkeypatch.setattr("rig.cli.compare.stimulus_maps", lambda *_: [])  # the whole finger would be factorised
    (tmp_path / "kept").mkdir()
    (tmp_path / "kept" / "one.model").write_bytes(b"kept")
    few = (Candidate("halfspace", "0.28 mm", coarse(0.28)),)
    monkeypatch.setattr("rig.cli.installation.QUICK", few)
    monkeypatch.setattr("rig.cli.installation.QUICK_SCENES", QUICK_SCENES[:1])
    return tmp_path


@pytest.mark.parametrize(("line", "about"), ASKED)
def test_every_json_answer_fits_its_schema(
    program: Program, folder: Path, monkeypatch: pytest.MonkeyPatch, line: str, about: str
) -> None:
    command = line.split()[0]
    if command in ("cache", "doctor"):
        monkeypatch.setenv("RIG_CACHE_DIR", "kept")
    if command == "find":
        assert program(*FOUND.split()).code == 0
        line = line.replace("*", next(Path("found").iterdir()).name)
    words = [*line.split(), *(COARSE if command in ON_A_COARSE_FINGER else ())]
    answer = program(*words, "--json").json
    if WRITES and not about:
        text = json.dumps(_short(answer), indent=1, ensure_ascii=False)
        (EXAMPLES / f"{command}.json").write_text(f"{text}\n", encoding="utf-8")


def test_every_command_with_json_has_a_schema_and_an_example_that_fits_it() -> None:
    printing = {words[0] for words, function in functions() if "as_json" in signature(function).parameters}
    assert printing == set(OUTPUTS) <= set(COMMANDS)
    for command in OUTPUTS:
        as_in_its_schema(command, json.loads((EXAMPLES / f"{command}.json").read_text(encoding="utf-8")))


def _values(schema: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
    """What a value may be, in whatever lists; not the values of a map, whose keys are of a configuration."""
    if "anyOf" in schema:
        for one in schema["anyOf"]:
            yield from _values(one)
    elif schema.get("type") == "array":
        for one in schema.get("prefixItems", [schema["items"]] if "items" in schema else []):
            yield from _values(one)
    else:
        yield schema


def _wrong(key: str, found: Mapping[str, Any], beside: Mapping[str, Any]) -> bool:
    """Whether a number lacks its unit, a text its list or format, or a unit is not of the list."""
    listed = {one for one in (*found.get("enum", ()), found.get("const")) if one is not None}
    if key == "unit" or key.endswith("_unit"):
        return found.get("type") not in ("object", None) and bool(listed - set(UNIT_FIELDS))
    if key.endswith("_text"):
        return found.get("type") not in ("string", "null") or bool(listed) or "format" in found
    if found.get("type") == "number":
        at_the_end = any(key == end or key.endswith(f"_{end}") for end in SUFFIXES)
        return not (at_the_end or {"unit", f"{key}_unit"} & set(beside) or found.get("unit") == "1")
    return found.get("type") == "string" and not listed and found.get("format") not in FORMATS


@pytest.mark.parametrize("command", OUTPUTS)
def test_every_key_of_a_json_schema_has_a_unit_list_or_format(command: str) -> None:
    objects = schema_of_command(command)["$defs"]
    assert not [name for name, one in objects.items() if one["additionalProperties"]]
    assert not [
        (name, key)
        for name, one in objects.items()
        for key, schema in one["properties"].items()
        for found in _values(schema)
        if _wrong(key, found, one["properties"])
    ]


def test_the_json_schema_option_needs_no_other_argument(program: Program) -> None:
    for command in ("stop", "calibrate", "calibrate steps", "compare"):
        printed = program(*command.split(), "--json-schema")
        assert (printed.code, json.loads(printed.out)) == (0, schema_of_command(command.split()[0]))


def test_output_of_a_script_goes_to_stderr_under_json(capsys: pytest.CaptureFixture[str]) -> None:
    for as_json in (True, False):
        with one_line_errors(as_json=as_json):
            print("asked")
            if as_json:
                print_json({"run": "r"})
        there = capsys.readouterr()
        assert (there.out, there.err) == (('{"run": "r"}\n', "asked\n") if as_json else ("asked\n", ""))
