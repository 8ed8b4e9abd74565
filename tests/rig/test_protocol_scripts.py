"""Scripts as files: found, loaded, given parameters, and what the check before anything moves says of their steps."""

from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from rig.errors import BadInputError
from rig.plan.config import Config
from rig.plan.plan import Plan, make_plan
from rig.protocol.script import Script, load_script, script_with
from sim.config import FingertipConfig
from sim.models.fingertip import Fingertip
from tests.error_codes import has_code, raises
from tests.sim.coarse_mesh import coarse_mesh

Fields = dict[str, Any]
SCRIPT = """\
from rig.protocol import Field, ProtocolParameters

class Parameters(ProtocolParameters):
    depth_mm: float = Field(0.5, gt=0, le=1.5)
    times: int = Field(1, ge=1, le=9)
    name: str = "a"

def run(rig):
    rig.mount("bar:3.0")
    rig.home()
    rig.zero()
    rig.move_to(x_mm=0.0)
    for _ in range(rig.parameters.times):
        rig.indent(doi_mm=rig.parameters.depth_mm)
"""
RUN = "def run(rig):\n    pass\n"
HEAD = "from rig.protocol import Field, ProtocolParameters\n\n\nclass Parameters(ProtocolParameters):\n"


def _write(folder: Path, text: str, name: str = "mine.py") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def _with(folder: Path, fields: str, **given: Any) -> Script:
    return script_with(_write(folder, f"{HEAD}    {fields}\n\n\n{RUN}"), "mine", given)


def _not_loaded(name: object, *assignments: str) -> BadInputError:
    with pytest.raises(BadInputError) as caught:
        load_script(str(name), assignments)
    assert "\n" not in str(caught.value)
    return caught.value


# --- found and loaded ---


def test_a_script_is_named_by_path_or_as_shipped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = _write(tmp_path, SCRIPT)
    assert load_script(str(path)).name == "mine"
    monkeypatch.chdir(tmp_path)
    assert load_script("mine.py").path == path.resolve()
    for name in ("steps", "steps.py"):
        shipped = load_script(name)
        assert shipped.name == "steps"
        assert shipped.title == "Step moved laterally across the pad"
        assert shipped.source.startswith("Raju 1998")
    _write(tmp_path, RUN, "steps.py")  # a file comes before a shipped script of its name
    assert load_script("steps.py").source == ""
    assert load_script("steps").source != ""


@pytest.mark.parametrize("name", ["stairs", "elsewhere/steps", "elsewhere/steps.py", "{}/steps.py"])
def test_a_missing_script_is_told_with_those_that_are_shipped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """A shipped one is named without a folder."""
    monkeypatch.chdir(tmp_path)
    known = "bars, cylinders, find_finger, first_press, gratings, line, paired_forces, steps"
    name = name.format(tmp_path)
    has_code(_not_loaded(name), "no_such_protocol", name=name, known=known)


WRONG_KIND: tuple[str, Fields] = ("wrong_parameters", {})


@pytest.mark.parametrize(
    ("name", "text", "code", "fields"),
    [
        ("mine.py", "x = 1\n", "no_run", {}),
        ("mine.py", "run = 1\n", "no_run", {}),
        ("mine.txt", "hello", "no_python_file", {}),
        ("mine.py", "def run(rig):\n    rig.home()\n    rig.move_to(x_mm=\n", "no_python", {"line": 3}),
        ("mine.py", f"class Parameters: pass\n{RUN}", *WRONG_KIND),
        ("mine.py", f"Parameters = {{'a': 1}}\n{RUN}", *WRONG_KIND),
        ("mine.py", f"Parameters = 3\n{RUN}", *WRONG_KIND),
    ],
)
def test_a_file_that_is_no_script(tmp_path: Path, name: str, text: str, code: str, fields: Fields) -> None:
    path = _write(tmp_path, text, name)
    has_code(_not_loaded(path), code, path=str(path), **fields)


@pytest.mark.parametrize(
    ("text", "line", "exception"),
    [
        ("import math\n\nroot = math.sqrt(-1)\n", 3, "ValueError"),
        ("import no_such_module_here\n", 1, "ModuleNotFoundError"),
        ("import sys\nsys.exit(3)\n", 2, "SystemExit"),
    ],
)
def test_an_exception_at_import_has_its_line(tmp_path: Path, text: str, line: int, exception: str) -> None:
    path = _write(tmp_path, text)
    has_code(_not_loaded(path), "exception_in_script", place=f"{path}, line {line}", exception=exception)


@pytest.mark.parametrize(
    ("metadata", "title", "source"),
    [
        ("{'title': 'Two presses', 'source': 'p. 12'}", "Two presses", "p. 12"),
        ("{'title': 3}", "3", ""),
        ("{}", "mine", ""),
    ],
)
def test_metadata_names_a_script(tmp_path: Path, metadata: str, title: str, source: str) -> None:
    for text in (f"METADATA = {metadata}\n{RUN}", RUN):
        script = load_script(str(_write(tmp_path, text)))
        assert (script.title, script.source) == ((title, source) if "METADATA" in text else ("mine", ""))
        assert script.parameters.model_dump() == {}


@pytest.mark.parametrize(
    ("metadata", "unknown"),
    [("{'titel': 'Two presses'}", "titel"), ("{'title': 'a', 'file': ['b.csv']}", "file"), ("'Two presses'", "str"),
     ("None", "NoneType"), ("['title']", "list")],
)  # fmt: skip
def test_metadata_that_mean_nothing_are_refused_with_what_is_known(
    tmp_path: Path, metadata: str, unknown: str
) -> None:
    path = _write(tmp_path, f"METADATA = {metadata}\n{RUN}")
    has_code(_not_loaded(path), "unknown_metadata", path=str(path), unknown=unknown, known="title, source, files")


def test_a_script_in_capitals_is_a_script(tmp_path: Path) -> None:
    assert load_script(str(_write(tmp_path, RUN, "MINE.PY"))).name == "MINE"


def test_annotations_may_be_postponed(tmp_path: Path) -> None:
    text = (
        f"from __future__ import annotations\nfrom typing import Literal\n{HEAD}    step: Literal['1', '3'] = '1'\n"
    )
    assert load_script(str(_write(tmp_path, text + RUN)), ["step=3"]).parameters.model_dump() == {"step": "3"}


# --- what lies beside a script ---


def test_modules_and_files_beside_a_script_are_its_own(tmp_path: Path) -> None:
    """Two scripts may import modules of one name, and a module hides no library."""
    found = []
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        _write(tmp_path / name, f"from more import TIMES\nWHERE = {name!r}\n", "places.py")
        _write(tmp_path / name, "TIMES = 3\n", "more.py")
        _write(tmp_path / name, "raise ValueError\n", "random.py")
        _write(tmp_path / name, "x_mm\n1\n", "trials.csv")
        text = f"import random\nimport places\nMETADATA = {{'title': places.WHERE, 'files': ['trials.csv']}}\n{RUN}"
        found.append(load_script(str(_write(tmp_path / name, text))))
    assert [script.title for script in found] == ["one", "two"]
    assert [set(script.beside) for script in found] == 2 * [{"places.py", "more.py", "trials.csv"}]
    assert found[1].beside["places.py"] == (tmp_path / "two" / "places.py").read_bytes()


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("METADATA = {'files': 'trials.csv'}\n", "wrong_files"),
        ("METADATA = {'files': [3]}\n", "wrong_files"),
        ("METADATA = {'files': ['missing.csv']}\n", "wrong_files"),
        *((f"METADATA = {{'files': ['{name}']}}\n", "wrong_files") for name in ("../trials.csv", "below/trials.csv")),
        *(
            (f"METADATA = {{'files': ['{name}']}}\n", "wrong_files")
            for name in ("Sample.csv", "config.toml", ".lock")
        ),
        ("import protocol\n", "exception_in_script"),
    ],
)
def test_a_file_beside_a_script_that_a_run_cannot_copy(tmp_path: Path, text: str, code: str) -> None:
    scripts = tmp_path / "scripts"
    (scripts / "below").mkdir(parents=True)
    for name in ("../trials.csv", "below/trials.csv", "Sample.csv", "config.toml", ".lock", "protocol.py"):
        _write(scripts, "", name)
    has_code(_not_loaded(_write(scripts, text + RUN)), code)


@pytest.mark.parametrize("planned", [False, True], ids=["at its top", "within run"])
@pytest.mark.parametrize(("name", "code"), [("lab", "module_beside_script"), ("pynotthere", "exception_in_script")])
def test_a_module_that_is_not_found(
    tmp_path: Path, finger: Fingertip, name: str, code: str, *, planned: bool
) -> None:
    (tmp_path / "lab").mkdir()
    if planned:
        has_code(_not_planned(tmp_path, finger, f"import {name}.depths"), code)
    else:
        has_code(_not_loaded(_write(tmp_path, f"import {name}.depths\n{RUN}")), code)


def test_a_module_beside_a_script_is_imported_at_its_top(tmp_path: Path, finger: Fingertip) -> None:
    _write(tmp_path, "DOI_MM = 0.5\n", "depths.py")
    has_code(_not_planned(tmp_path, finger, "import depths"), "module_beside_script")


# --- parameters ---


def test_set_changes_what_it_names(tmp_path: Path) -> None:
    path = str(_write(tmp_path, SCRIPT))
    assert load_script(path).parameters.model_dump() == {"depth_mm": 0.5, "times": 1, "name": "a"}
    script = load_script(path, ["depth_mm=1e-1", "name=b=c"])
    assert script.parameters.model_dump() == {"depth_mm": 0.1, "times": 1, "name": "b=c"}
    assert load_script("steps", ["step=3"]).parameters.step == "3"


KNOWN = {"known": "depth_mm, times, name", "file": "mine.py", "where": "--set"}


@pytest.mark.parametrize(
    ("assignments", "code", "fields"),
    [
        (["dept_mm=1"], "unknown_key", {"key": "dept_mm", **KNOWN}),
        (["depth_mm=deep"], "invalid_value", {"key": "depth_mm", "value": "deep", "rule": "float_parsing", **KNOWN}),
        (["times=1.5"], "invalid_value", {"key": "times", "value": "1.5", "rule": "int_parsing"}),
        (
            ["depth_mm=1.6"],
            "invalid_value",
            {"key": "depth_mm", "value": "1.6", "rule": "less_than_equal", "le": 1.5},
        ),
        (["depth_mm=0"], "invalid_value", {"key": "depth_mm", "value": "0", "rule": "greater_than", "gt": 0.0}),
        (["depth_mm=nan"], "invalid_value", {"key": "depth_mm", "value": "nan", "rule": "finite_number"}),
        (["depth_mm=-inf"], "invalid_value", {"key": "depth_mm", "value": "-inf", "rule": "finite_number"}),
        (["times=2", "times=3"], "given_twice", {"text": "times=3", "key": "times"}),
        (["times"], "no_assignment", {"text": "times"}),
        (["times="], "no_assignment", {"text": "times="}),
        (["=3"], "no_assignment", {"text": "=3"}),
    ],
)
def test_set_errors(tmp_path: Path, assignments: list[str], code: str, fields: Fields) -> None:
    has_code(_not_loaded(_write(tmp_path, SCRIPT), *assignments), code, **fields)


def test_a_choice_lists_what_there_is() -> None:
    error = _not_loaded("steps", "step=2")
    has_code(error, "invalid_value", key="step", value="2", rule="literal_error", expected="'1', '3' or '5'")


def test_a_script_without_parameters_says_so(tmp_path: Path) -> None:
    error = _not_loaded(_write(tmp_path, RUN), "force_gwt=1")
    has_code(error, "unknown_key", key="force_gwt", known="none", file="mine.py")


HIGH = {"key": "force_gwt", "value": 4.0, "rule": "less_than_equal", "le": 3}
ITS_OWN_RULE = "\n    ".join(
    (
        "low: int = 1",
        "",
        "def model_post_init(self, context):",
        "    if self.low > 1:",
        "        raise ValueError('low: expected at most 1')",
    )
)


@pytest.mark.parametrize(
    ("parameters", "given", "code", "fields"),
    [
        ("force_gwt: float = Field(4.0, le=3)", {}, "invalid_value", HIGH),
        ("force_gwt: float = 2.0", {"force_gwt": float("inf")}, "invalid_value", {"rule": "finite_number"}),
        ("force_gwt: float = 2.0", {"force_gwt": float("nan")}, "invalid_value", {"rule": "finite_number"}),
        (
            "force_gwt: float\n    hold_s: float = 1.0", {},
            "missing_key", {"key": "force_gwt", "known": "force_gwt, hold_s"},
        ),
        (  # the first of several problems
            "first: int = 1\n    second: int = 2", {"first": "a", "second": "b"},
            "invalid_value", {"key": "first", "value": "a", "rule": "int_parsing"},
        ),
        (  # in its own words
            ITS_OWN_RULE, {"low": 2},
            "invalid_table", {"key": "", "problem": "--set: low: expected at most 1", "known": "low"},
        ),
    ],
    ids=["default beyond its bound", "infinite", "nan", "not given", "first of several", "its own rule"],
)  # fmt: skip
def test_parameters_that_cannot_be(tmp_path: Path, parameters: str, given: Fields, code: str, fields: Fields) -> None:
    with raises(BadInputError, code, where="--set", file="mine.py", **fields):
        _with(tmp_path, parameters, **given)


def test_parameters_stay_as_they_were_checked(tmp_path: Path) -> None:
    parameters = _with(tmp_path, "force_gwt: float = Field(2.0, le=3)").parameters
    with pytest.raises(ValidationError) as caught:
        parameters.force_gwt = 4.0  # type: ignore[attr-defined]
    assert caught.value.errors()[0]["type"] == "frozen_instance"


@pytest.mark.parametrize(
    ("given", "shown"),
    [
        ([1, 2, 3, 4, 5], "[1, 2, 3, ...]"),
        ([{"a": 1, "b": 2, "c": 3, "d": 4}], "[{'a': 1, 'b': 2, 'c': 3, ...}]"),
        ("9" * 150 + "x" * 150, f"'{'9' * 97}...{'x' * 98}'"),
    ],
    ids=["list", "table", "text"],
)
def test_long_values_are_told_in_short(tmp_path: Path, given: object, shown: str) -> None:
    """Of a list or a table the first three, of a text 200 characters."""
    with raises(BadInputError, "invalid_value", key="count", value=given, shown=shown) as caught:
        _with(tmp_path, "count: int = 1", count=given)
    assert len(shown) <= 200
    assert f"count = {shown}: " in str(caught.value)


# --- the check before anything moves: tests/rig/test_limits_table.py for the limits themselves ---


READY = "rig.mount('bar:3.0'); rig.home(); rig.zero(); rig.move_to(x_mm=0.0); "


def _script(folder: Path, body: str) -> Script:
    return load_script(str(_write(folder, f"def run(rig):\n    {body}\n")))


def _not_planned(folder: Path, finger: Fingertip, body: str, config: Config | None = None) -> BadInputError:
    script = _script(folder, body)
    with pytest.raises(BadInputError) as caught:
        make_plan(script, config or Config(), finger)
    assert "\n" not in str(caught.value)
    assert caught.value.fields["place"] == f"{script.path}, line 2"
    assert str(caught.value).startswith(f"{script.path}, line 2: ")
    return caught.value


@pytest.mark.parametrize(
    ("body", "code", "fields"),
    [
        ("rig.zero()", "comes_too_early", {"verb": "zero", "before": "home()"}),
        ("rig.home(); rig.move_to(x_mm=6.5)", "outside_limits", {"verb": "move_to", "value": 6.5}),
        ("rig.mount('tube:3')", "no_such", {"shape": "tube:3"}),
        ("rig.mount('bar:wide')", "no_dimension", {"shape": "bar:wide"}),
        ("rig.note(3)", "no_text", {"verb": "note", "value": 3}),
        (READY + "rig.indent()", "not_one_target", {"verb": "indent"}),
        (READY + "rig.indent(doi_mm=0.5, increments=2.5)", "no_count", {"key": "increments", "value": 2.5}),
        (READY + "rig.indent(doi_mm=0.5, speed_mm_s=6)", "outside_range", {"key": "speed_mm_s", "high": 5.0}),
        (READY + "rig.indent(doi_mm=1.6)", "beyond_limit", {"limit": "max_doi_mm", "value": 1.6}),
        (READY + "rig.jump()", "unknown_verb", {"exception": "AttributeError", "verb": "jump"}),
        (READY + "rig.rest()", "wrong_arguments", {"exception": "TypeError", "verb": "rest", "arguments": "seconds"}),
        (READY + "1 / 0", "exception_in_script", {"exception": "ZeroDivisionError"}),
    ],
)
def test_a_step_that_cannot_be_done_is_named_with_its_line(
    tmp_path: Path, finger: Fingertip, body: str, code: str, fields: Fields
) -> None:
    has_code(_not_planned(tmp_path, finger, body), code, **fields)


def test_past_the_patch(tmp_path: Path, finger: Fingertip) -> None:
    body = READY.replace("x_mm=0.0", "x_mm=5.8") + "rig.indent(doi_mm=0.5)"
    error = _not_planned(tmp_path, finger, body)
    has_code(error, "touch_beside_patch", axis="x", touch_mm=pytest.approx(4.10, abs=0.005))


@pytest.mark.parametrize(
    ("tables", "code", "fields"),
    [
        ({"limits": {"max_force_gwt": 5.0}}, "means_beyond_limit", {"limit": "max_force_gwt", "high": 5.0}),
        (
            {"limits": {"max_pressure_kpa": 5.0}},
            "means_beyond_limit", {"limit": "max_pressure_kpa", "high": 5.0},
        ),
        (
            {"frame": {"apex_z_mm": -39.5}},
            "outside_travel", {"axis": "z", "machine_mm": pytest.approx(-40.5, abs=0.1), "low": -40.0},
        ),
        ({"frame": {"pad_centre_x_mm": -70.0}}, "outside_travel", {"axis": "x", "machine_mm": -70.0, "low": -60.0}),
    ],
)  # fmt: skip
def test_limits_of_force_pressure_and_travel(
    tmp_path: Path, finger: Fingertip, tables: Fields, code: str, fields: Fields
) -> None:
    body = READY + "rig.indent(doi_mm=1.0)"
    has_code(_not_planned(tmp_path, finger, body, Config.model_validate(tables)), code, **fields)


@pytest.mark.parametrize(
    ("habit", "body", "verb"),
    [
        ("press_speed_mm_s", "rig.indent(doi_mm=0.3)", "indent"),
        ("approach_speed_mm_s", "rig.indent(doi_mm=0.3)", "indent"),
        ("approach_speed_mm_s", "rig.touch()", "touch"),
        ("press_speed_mm_s", "rig.reference(x_mm=0.0, doi_mm=0.3)", "reference"),
    ],
)
def test_every_speed_is_checked(tmp_path: Path, finger: Fingertip, habit: str, body: str, verb: str) -> None:
    """Of settings that no file gave, since a file with these is refused."""
    config = Config()
    habits = config.habits.model_copy(update={habit: 1.5})
    limits = config.limits.model_copy(update={"max_press_speed_mm_s": 1.0})
    config = config.model_copy(update={"habits": habits, "limits": limits})
    error = _not_planned(tmp_path, finger, READY + body, config)
    has_code(error, "outside_range", verb=verb, key=f"habits.{habit}", value=1.5, high=1.0)
    make_plan(_script(tmp_path, READY + "rig.indent(doi_mm=0.3, speed_mm_s=0.5)"), Config(), finger)


def test_the_plan_predicts(tmp_path: Path, finger: Fingertip) -> None:
    body = READY + "rig.indent(doi_mm=0.3); rig.indent(force_gwt=2.33, increments=2, hold_s=0.5)"
    script = _script(tmp_path, body)
    plan = make_plan(script, Config(), finger)
    first, second = plan.indentations
    assert first.predicted_force_gwt == pytest.approx(finger.indent("bar:3.0", 0.0, doi_mm=0.3).force_gwt, rel=1e-6)
    assert second.predicted_force_gwt == pytest.approx(2.33, rel=1e-3)
    assert (second.increments, second.hold_s) == (2, 0.5)
    assert plan.peak_force_gwt == max(first.predicted_force_gwt, second.predicted_force_gwt)
    assert Plan().peak_force_gwt == 0.0


@pytest.fixture(scope="module")
def coarse() -> Fingertip:
    """The default finger on few elements."""
    return Fingertip.load(FingertipConfig(mesh=coarse_mesh(0.34, 0.68)))


@pytest.mark.parametrize(
    ("name", "settings", "steps"),
    [
        ("steps", "step=1", 21),
        ("steps", "step=3", 22),
        ("steps", "step=5", 21),
        ("bars", "width_mm=1.5", 25),
        ("bars", "width_mm=3.0", 34),
        ("cylinders", "diameter_mm=3", 3),
        ("cylinders", "diameter_mm=9", 3),
        ("cylinders", "force_gwt=20", 1),
        ("gratings", "periods=1", 10),
        ("paired_forces", "hold_s=1", 8),
    ],
)
def test_the_shipped_scripts_can_be_done(coarse: Fingertip, name: str, settings: str, steps: int) -> None:
    plan = make_plan(load_script(name, [settings]), Config(finger=coarse.config), coarse)
    assert len(plan.indentations) == steps
    assert 0 < plan.peak_force_gwt < 100
