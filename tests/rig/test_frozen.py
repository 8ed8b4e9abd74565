"""What others rely on, as lists under tests/frozen: what is there may change only on purpose, in that commit.

FROZEN=write pytest -n 0 tests/rig/test_frozen.py    # writes the lists anew: look at the difference
"""

import ast
import inspect
import json
import os
import re
import shutil
from bisect import bisect_left
from collections.abc import Callable, Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any, Literal, get_args, get_origin, get_type_hints
from warnings import catch_warnings, simplefilter

import numpy as np
import pytest
import typer
from typer.models import ArgumentInfo, ParameterInfo

from rig.cli.json_schemas import OUTPUTS, schema_of
from rig.cli.output import ExitCode
from rig.cli.program import COMMANDS
from rig.data import Run
from rig.data.schema import STREAMS
from rig.plan.config import Config
from rig.plan.nerve import MeasureTable, Visits
from sim.benchmark import QUICK_SCENES, Candidate, coarse
from sim.measures.measures import MEASURES
from sim.models.fingertip import Fingertip
from sim.nerve.population import AfferentPopulation
from studies.reference_run import BENCHES, carried_out, fingerprint
from tests.program import Program
from tests.sim.coarse_mesh import as_toml, coarse_mesh

ROOT = Path(__file__).parents[2]
FROZEN = ROOT / "tests" / "frozen"
OLD_RUNS = ROOT / "tests" / "data" / "runs_of_0_1"
WRITES = os.environ.get("FROZEN") == "write"
DOCUMENTED = ("README.md", "docs", "examples", "protocols")
OURS = ("rig", "sim", "rig_shared")


def _as_frozen(name: str, found: list[str]) -> None:
    path = FROZEN / name
    if WRITES:
        path.write_text("".join(f"{line}\n" for line in found), encoding="utf-8")
    assert found == path.read_text(encoding="utf-8").splitlines()


def _part_as_frozen(name: str, begins: str, found: list[str]) -> None:
    """Of a list that several tests share: the lines that begin so."""
    path = FROZEN / name
    known = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    if WRITES:
        others = [line for line in known if not line.startswith(begins)]
        at = bisect_left(others, begins)
        known = [*others[:at], *found, *others[at:]]
        path.write_text("".join(f"{line}\n" for line in known), encoding="utf-8")
    assert found == [line for line in known if line.startswith(begins)]


# --- what is known without running anything ---


def _commands() -> Iterator[str]:
    """Each command, and each argument and option: kind, default, range, and the words that its metavar offers."""
    for name, command in COMMANDS.items():
        module, _, function = command.where.partition(".")
        found = getattr(import_module(f"rig.cli.{module}"), function)
        inner = found.registered_commands if isinstance(found, typer.Typer) else []
        for one in inner:
            assert one.callback is not None
            yield from _options(f"{name} {one.name or one.callback.__name__}", one.callback)
        if not inner:
            yield from _options(name, found)


def _options(command: str, function: Callable[..., Any]) -> Iterator[str]:
    hints = get_type_hints(function, include_extras=True)
    yield command
    for name, parameter in inspect.signature(function).parameters.items():
        if hints[name] is typer.Context:
            continue
        kind, info = get_args(hints[name])[:2]
        assert isinstance(info, ParameterInfo)
        given = [word for word in (info.default, *(info.param_decls or ())) if isinstance(word, str)]
        usual = f"{name.upper()}" if isinstance(info, ArgumentInfo) else f"--{name.replace('_', '-')}"
        optional = parameter.default is not inspect.Parameter.empty
        told = [f"{command} {', '.join(given) or usual}", _kind(kind)]
        told += [f"default {_value(parameter.default)}" if optional else "required"]
        told += [f"{info.min} … {info.max}"] if (info.min, info.max) != (None, None) else []
        told += [info.metavar] if "|" in (info.metavar or "") else []
        yield "  ".join(map(str, told))


def _kind(kind: Any) -> str:
    if get_origin(kind) is Literal:
        return "|".join(get_args(kind))
    return re.sub(r"pathlib\.", "", kind.__name__ if isinstance(kind, type) and not get_args(kind) else str(kind))


def _value(value: Any) -> str:
    return str(value.value if hasattr(value, "value") else value) or '""'


def _schema() -> Iterator[str]:
    """The configuration's JSON schema, without what is only read by people."""
    yield from json.dumps(_bare(Config.model_json_schema()), indent=1, ensure_ascii=False).splitlines()


def _bare(schema: Any, named: bool = False) -> Any:
    """named: the keys of this table are names of the configuration."""
    if isinstance(schema, dict):
        kept = {key: value for key, value in schema.items() if named or key not in ("description", "title")}
        return {key: _bare(value, not named and key in ("properties", "$defs")) for key, value in kept.items()}
    return [_bare(one) for one in schema] if isinstance(schema, list) else schema


def _streams() -> Iterator[str]:
    for name, keys in STREAMS.items():
        yield from (f"{name} {key} {unit}".rstrip() for key, unit in keys.items())


def _ways_to_end() -> Iterator[str]:
    yield from (f"{code.value} {code.name}" for code in ExitCode)


def commands_with(option: str) -> Iterator[str]:
    """Commands of which a parameter has this name, or those of a group."""
    for name, command in COMMANDS.items():
        module, _, function = command.where.partition(".")
        found = getattr(import_module(f"rig.cli.{module}"), function)
        inner = [one.callback for one in found.registered_commands] if isinstance(found, typer.Typer) else [found]
        if any(option in inspect.signature(one).parameters for one in inner if one is not None):
            yield name


def _json_keys() -> Iterator[str]:
    """Every key that a command prints with --json, with the keys above it; those of a failure once."""
    for command in OUTPUTS:
        schema = schema_of(command)
        *outputs, failure = schema["anyOf"]
        for key in dict.fromkeys(_of_schema({"anyOf": outputs}, schema["$defs"], ())):
            yield f"{command}: {key}"
    yield from (f"failure: {key}" for key in _of_schema(failure, schema["$defs"], ()))


def _of_schema(schema: Any, named: Mapping[str, Any], place: tuple[str, ...]) -> Iterator[str]:
    if "$ref" in schema:
        schema = named[schema["$ref"].removeprefix("#/$defs/")]
    for key, inner in schema.get("properties", {}).items():
        yield ".".join((*place, key))
        yield from _of_schema(inner, named, (*place, key))
    for inner in schema.get("anyOf", ()):
        yield from _of_schema(inner, named, place)
    if "items" in schema:
        yield from _of_schema(schema["items"], named, (*place[:-1], f"{place[-1]}[]"))


LISTS: Mapping[str, Callable[[], Iterator[str]]] = {
    "commands.txt": _commands,
    "config_schema.json": _schema,
    "exit_codes.txt": _ways_to_end,
    "json_keys.txt": _json_keys,
    "journal_streams.txt": _streams,
}
"""The keys of the configuration with defaults and bounds: tests/data/config_keys.txt."""


@pytest.mark.parametrize("name", LISTS)
def test_a_list_is_as_it_was(name: str) -> None:
    _as_frozen(name, list(LISTS[name]()))


# --- what is imported ---


def _imported(text: str) -> Iterator[str]:
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in OURS:
            yield from (f"{node.module} {one.name}" for one in node.names)
        elif isinstance(node, ast.Import):
            yield from (one.name for one in node.names if one.name.split(".")[0] in OURS)


def _documented() -> Iterator[str]:
    """What packages export, and what pages, examples and shipped protocols import."""
    for package in ("rig", "sim", "rig_shared"):
        for place in sorted((ROOT / package).rglob("__init__.py")):
            module = ".".join(place.parent.relative_to(ROOT).parts)
            yield from (f"{module} {name}" for name in getattr(import_module(module), "__all__", ()))
    for name in DOCUMENTED:
        place = ROOT / name
        for page in [place] if place.is_file() else sorted(place.rglob("*")):
            if page.suffix == ".py" and name != "docs":  # there they make pages
                yield from _imported(page.read_text(encoding="utf-8"))
            elif page.suffix == ".md" and "decisions" not in page.parts:
                for block in re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.S):
                    yield from _imported(block)


def test_what_was_imported_once_is_imported_still() -> None:
    """The list only grows: an old name answers for a release, wherever it has gone."""
    path = FROZEN / "imports.txt"
    known = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    now = set(_documented())
    if WRITES:
        known = sorted({*known, *now})
        path.write_text("".join(f"{line}\n" for line in known), encoding="utf-8")
    assert now <= set(known)
    with catch_warnings():
        simplefilter("ignore", DeprecationWarning)  # of names that have gone elsewhere
        for line in known:
            module, _, name = line.partition(" ")
            found = import_module(module)
            assert not name or hasattr(found, name) or import_module(f"{module}.{name}"), line


# --- what commands answer ---

SCRIPT = "def run(rig):\n    rig.mount('bar:3.0')\n    rig.home()\n    rig.zero()\n    rig.move_to(x_mm=0.0)\n"
COARSE = ("--config", "coarse.toml")
# What commands are asked, each in a folder of its own. tests/rig/real_time asks those at the bench,
# test_identification asks identify: whatever a test reads as JSON is held against the schema of
# its command (tests/program.py).
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


def _keys(value: Any, place: str = "") -> Iterator[str]:
    """Each key with the keys above it; what lists have in common is said once."""
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield f"{place}.{key}".lstrip(".")
            yield from _keys(inner, f"{place}.{key}".lstrip("."))
    elif isinstance(value, list):
        for inner in value:
            yield from _keys(inner, f"{place}[]")


EXAMPLES = ROOT / "docs" / "json_examples"


def _short(value: Any) -> Any:
    """An answer for the documentation: the first items of a list, six digits of a number."""
    if isinstance(value, Mapping):
        return {key: _short(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [_short(inner) for inner in value[:2]]
    return float(f"{value:.6g}") if isinstance(value, float) else value


def _cheap_tables(run: Run, found: Visits, finger: Fingertip, afferents: AfferentPopulation, told: object) -> Any:
    """What every afferent has at every place: as much as the depth squared."""
    depths = np.linspace(0.05, 0.6, 4)
    felt = [afferents.measure(dict.fromkeys(MEASURES, np.full(len(afferents), 120 * depth**2))) for depth in depths]
    return {visit.place: MeasureTable(depths, np.array(felt)) for visit in found.visits}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, empty_figures: None) -> Path:
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
    monkeypatch.setattr("rig.plan.nerve.tables_of", _cheap_tables)  # and here
    (tmp_path / "kept").mkdir()
    (tmp_path / "kept" / "one.model").write_bytes(b"kept")
    few = (Candidate("halfspace", "0.28 mm", coarse(0.28)),)
    monkeypatch.setattr("rig.cli.installation.QUICK", few)
    monkeypatch.setattr("rig.cli.installation.QUICK_SCENES", QUICK_SCENES[:1])
    return tmp_path


@pytest.mark.parametrize(("line", "about"), ASKED)
def test_an_answer_in_json_is_as_its_schema_says(
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
    if (command, about) == ("dry-run", ""):
        _as_frozen("run_files.txt", sorted(path.name for path in Path(answer["run"]).iterdir()))


# --- what a run leaves behind ---


@pytest.mark.parametrize("bench", BENCHES)
def test_the_demo_sends_and_records_what_it_did(bench: str, finger: Fingertip, tmp_path: Path) -> None:
    """Byte for byte, and number by number in its journal (studies/reference_run.py)."""
    run = carried_out(bench, finger, tmp_path)
    _part_as_frozen("reference_run.txt", f"{bench} ", list(fingerprint(bench, run)))
    if bench == "grbl":
        _as_frozen("run_folder.txt", list(_left(run)))


def _left(run: Path) -> Iterator[str]:
    """Every file of the folder with its keys or columns, and the keys of each kind of document of the journal."""
    for path in sorted(run.iterdir()):
        yield path.name
        if path.suffix == ".csv":
            yield from (f"{path.name}: {column}" for column in path.read_text("utf-8").splitlines()[0].split(","))
        elif path.suffix == ".json":
            yield from (f"{path.name}: {key}" for key in dict.fromkeys(_keys(json.loads(path.read_text("utf-8")))))
        elif path.suffix == ".jsonl":
            yield from _documents(path)


def _documents(path: Path) -> Iterator[str]:
    kinds: dict[str, None] = {}
    for line in path.read_text(encoding="utf-8").splitlines():
        document = json.loads(line)
        kind = document.get("doc", "")
        inner = () if kind in ("event", "descriptor") else ("parameters", "indentor")
        for key, value in document.items():
            kinds[f"{path.name}: {kind} {key}".replace("  ", " ")] = None
            if key in inner and isinstance(value, dict):
                kinds |= dict.fromkeys(f"{path.name}: {kind} {key}.{name}" for name in value)
    yield from kinds
