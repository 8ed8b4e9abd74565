"""Scripts as files: found, loaded, given parameters, and what the check before anything moves says of their steps."""

from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from rig.errors import BadInputError
from rig.plan.config import Config
from rig.plan.plan import make_plan
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


def test_a_script_is_loaded_by_path_or_by_its_shipped_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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


@pytest.mark.parametrize(
    ("text", "line", "exception"),
    [
        ("import no_such_module_here\n", 1, "ModuleNotFoundError"),
        ("import sys\nsys.exit(3)\n", 2, "SystemExit"),
    ],
)
def test_an_exception_at_the_import_of_a_script_is_reported_with_its_line(
    tmp_path: Path, text: str, line: int, exception: str
) -> None:
    path = _write(tmp_path, text)
    has_code(_not_loaded(path), "exception_in_script", place=f"{path}, line {line}", exception=exception)


def test_a_script_may_postpone_annotations(tmp_path: Path) -> None:
    text = (
        f"from __future__ import annotations\nfrom typing import Literal\n{HEAD}    step: Literal['1', '3'] = '1'\n"
    )
    assert load_script(str(_write(tmp_path, text + RUN)), ["step=3"]).parameters.model_dump() == {"step": "3"}


# --- what lies beside a script ---


def test_two_scripts_may_import_different_modules_of_one_name(tmp_path: Path) -> None:
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


def test_importing_a_module_from_a_folder_beside_a_script_is_refused(tmp_path: Path, finger: Fingertip) -> None:
    (tmp_path / "lab").mkdir()
    has_code(_not_planned(tmp_path, finger, "import lab.depths"), "module_beside_script")
    has_code(_not_loaded(_write(tmp_path, f"import lab.depths\n{RUN}")), "module_beside_script")


def test_importing_a_module_within_run_is_refused(tmp_path: Path, finger: Fingertip) -> None:
    _write(tmp_path, "DOI_MM = 0.5\n", "depths.py")
    has_code(_not_planned(tmp_path, finger, "import depths"), "module_beside_script")


def test_every_pass_of_a_script_has_the_same_parameters(tmp_path: Path) -> None:
    """A validator that converts a value does so once."""
    converts = "    @field_validator('x_um')\n    def in_mm(cls, x_um):\n        return x_um / 1000\n"
    text = f"from pydantic import field_validator\n{HEAD}    x_um: float = 300.0\n    doi_mm: float = 0.5\n{converts}"
    for given, x_mm in (({}, 0.3), ({"x_um": "200"}, 0.2)):
        script = script_with(_write(tmp_path, f"{text}\n\n{RUN}"), "mine", given)
        assert (
            script.fresh().parameters.model_dump() == script.parameters.model_dump() == {"x_um": x_mm, "doi_mm": 0.5}
        )


def test_every_pass_of_a_script_runs_the_text_that_was_loaded_first(tmp_path: Path) -> None:
    """A script that is edited while it runs presses what was planned, and what the run has a copy of."""
    _write(tmp_path, "DOI_MM = 0.5\n", "depths.py")
    path = _write(tmp_path, f"from depths import DOI_MM\n{RUN}")
    script = load_script(str(path))
    path.write_text("nothing", encoding="utf-8")
    (tmp_path / "depths.py").unlink()
    fresh = script.fresh()
    assert fresh.run is not script.run
    assert fresh.beside == {"depths.py": b"DOI_MM = 0.5\n"}


# --- parameters ---


def test_set_options_change_only_the_parameters_they_name(tmp_path: Path) -> None:
    path = str(_write(tmp_path, SCRIPT))
    assert load_script(path).parameters.model_dump() == {"depth_mm": 0.5, "times": 1, "name": "a"}
    script = load_script(path, ["depth_mm=1e-1", "name=b=c"])
    assert script.parameters.model_dump() == {"depth_mm": 0.1, "times": 1, "name": "b=c"}
    assert load_script("steps", ["step=3"]).parameters.step == "3"


def test_script_parameters_cannot_be_changed_after_their_check(tmp_path: Path) -> None:
    parameters = _with(tmp_path, "force_gwt: float = Field(2.0, le=3)").parameters
    with pytest.raises(ValidationError) as caught:
        parameters.force_gwt = 4.0  # type: ignore[attr-defined]
    assert caught.value.errors()[0]["type"] == "frozen_instance"


# --- the check before anything moves: tests/rig/test_limits_table.py for the limits themselves ---


READY = "rig.mount('bar:3.0'); rig.home(); rig.zero(); rig.move_to(x_mm=0.0); "


def _script(folder: Path, body: str) -> Script:
    return load_script(str(_write(folder, f"def run(rig):\n    {body}\n")))


def _not_planned(folder: Path, finger: Fingertip, body: str, config: Config | None = None) -> BadInputError:
    script = _script(folder, body)
    with pytest.raises(BadInputError) as caught:
        make_plan(script, config or Config(), finger)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(f"{script.path}, line 2: ")
    return caught.value


@pytest.mark.parametrize(
    ("body", "code", "fields"),
    [
        ("rig.zero()", "comes_too_early", {"verb": "zero", "before": "home()"}),
        ("rig.mount('bar:wide')", "no_dimension", {"shape": "bar:wide"}),
        ("rig.note(3)", "no_text", {"verb": "note", "value": 3}),
        (READY + "rig.indent(doi_mm=1.6)", "beyond_limit", {"limit": "max_doi_mm", "value": 1.6}),
        (READY + "rig.jump()", "unknown_verb", {"exception": "AttributeError", "verb": "jump"}),
        (READY + "1 / 0", "exception_in_script", {"exception": "ZeroDivisionError"}),
        (READY + "raise SystemExit('enough')", "exception_in_script", {"problem": "SystemExit: enough"}),
    ],
)
def test_a_step_that_cannot_be_carried_out_is_named_with_its_line(
    tmp_path: Path, finger: Fingertip, body: str, code: str, fields: Fields
) -> None:
    has_code(_not_planned(tmp_path, finger, body), code, **fields)


@pytest.mark.parametrize(
    ("script", "code"),
    [
        ("async def run(rig):\n    pass\n", "asynchronous"),
        (f"def run(rig):\n    {READY}rig.precondition(presses=1, doi_mm=0.2)\n", "indents_nowhere"),
    ],
)
def test_a_script_that_is_asynchronous_or_makes_no_press_for_data_is_refused(
    tmp_path: Path, finger: Fingertip, script: str, code: str
) -> None:
    path = _write(tmp_path, script)
    with raises(BadInputError, code, path=str(path)):
        make_plan(load_script(str(path)), Config(), finger)


@pytest.fixture(scope="module")
def coarse() -> Fingertip:
    """The default finger on few elements."""
    return Fingertip.load(FingertipConfig(mesh=coarse_mesh(0.34, 0.68)))


@pytest.mark.parametrize(
    ("name", "settings", "steps"),
    [
        ("steps", "step=1", 21),
        ("steps", "step=5", 21),
        ("bars", "width_mm=3.0", 34),
        ("cylinders", "diameter_mm=9", 3),
        ("cylinders", "force_gwt=20", 1),
        ("gratings", "periods=1", 10),
        ("paired_forces", "hold_s=1", 8),
    ],
)
def test_every_shipped_script_can_be_planned(coarse: Fingertip, name: str, settings: str, steps: int) -> None:
    plan = make_plan(load_script(name, [settings]), Config(finger=coarse.config), coarse)
    assert len(plan.indentations) == steps
    assert 0 < plan.peak_force_gwt < 100
