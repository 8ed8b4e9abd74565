"""Protocol scripts: found, loaded, given parameters, and checked before anything moves."""

from pathlib import Path

import pytest

from rig.plan.config import Config
from rig.plan.plan import Plan, make_plan
from rig.protocol.errors import BadInputError
from rig.protocol.script import Script, load_script
from sim.config.fingertip_config import FingertipConfig, MeshSpec
from sim.models.fingertip import Fingertip

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


def _write(folder: Path, text: str) -> Path:
    path = folder / "mine.py"
    path.write_text(text, encoding="utf-8")
    return path


def _load_complaint(name: object, *assignments: str) -> str:
    with pytest.raises(BadInputError) as caught:
        load_script(str(name), assignments)
    assert "\n" not in str(caught.value)
    return str(caught.value)


# --- loading ---


def test_a_script_is_named_by_path_or_as_shipped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = _write(tmp_path, SCRIPT)
    assert load_script(str(path)).name == "mine"
    monkeypatch.chdir(tmp_path)
    for name in ("steps", "steps.py"):
        shipped = load_script(name)
        assert shipped.name == "steps"
        assert shipped.title == "Step moved laterally across the pad"
        assert shipped.source.startswith("Raju 1998")


def test_a_missing_script(tmp_path: Path) -> None:
    assert _load_complaint("stairs") == (
        "protocol 'stairs': no such file, and not a shipped one "
        "(bars, cylinders, find_finger, first_press, gratings, line, paired_forces, steps)"
    )
    assert "no such file" in _load_complaint(tmp_path / "steps.py")


def test_a_script_without_run(tmp_path: Path) -> None:
    path = _write(tmp_path, "x = 1\n")
    assert _load_complaint(path) == f"protocol {path}: has no run(rig)"
    path = _write(tmp_path, "run = 1\n")
    assert _load_complaint(path) == f"protocol {path}: has no run(rig)"


def test_a_syntax_error_has_its_line(tmp_path: Path) -> None:
    path = _write(tmp_path, "def run(rig):\n    rig.home()\n    rig.move_to(x_mm=\n")
    assert _load_complaint(path) == f"protocol {path}, line 3: '(' was never closed"


def test_an_exception_at_import_has_its_line(tmp_path: Path) -> None:
    path = _write(tmp_path, "import math\n\nroot = math.sqrt(-1)\n")
    assert _load_complaint(path).startswith(f"protocol {path}, line 3: ValueError: ")
    path = _write(tmp_path, "import no_such_module_here\n")
    assert f"{path}, line 1: ModuleNotFoundError" in _load_complaint(path)


def test_not_a_python_file(tmp_path: Path) -> None:
    path = tmp_path / "steps.txt"
    path.write_text("hello", encoding="utf-8")
    assert _load_complaint(path) == f"protocol {path}: not a Python file"


@pytest.mark.parametrize("kind", ["class Parameters: pass", "Parameters = {'a': 1}", "Parameters = 3"])
def test_parameters_of_the_wrong_kind(tmp_path: Path, kind: str) -> None:
    path = _write(tmp_path, f"{kind}\ndef run(rig): pass\n")
    assert _load_complaint(path) == (
        f"protocol {path}: Parameters must be a subclass of rig.protocol.ProtocolParameters"
    )


def test_a_script_needs_no_parameters_and_no_metadata(tmp_path: Path) -> None:
    script = load_script(str(_write(tmp_path, "def run(rig): pass\n")))
    assert (script.title, script.source) == ("mine", "")
    assert script.parameters.model_dump() == {}


# --- --set ---


def test_set_changes_what_it_names(tmp_path: Path) -> None:
    path = str(_write(tmp_path, SCRIPT))
    assert load_script(path).parameters.model_dump() == {"depth_mm": 0.5, "times": 1, "name": "a"}
    script = load_script(path, ["depth_mm=1e-1", "name=b=c"])
    assert script.parameters.model_dump() == {"depth_mm": 0.1, "times": 1, "name": "b=c"}
    assert load_script("steps", ["step=3"]).parameters.step == "3"


@pytest.mark.parametrize(
    ("assignments", "complaint"),
    [
        (["dept_mm=1"], "--set: dept_mm: there is no such key (parameters of mine.py: depth_mm, times, name)"),
        (["depth_mm=deep"], "--set: depth_mm = 'deep': input should be a valid number"),
        (["times=1.5"], "--set: times = '1.5': input should be a valid integer"),
        (["depth_mm=1.6"], "--set: depth_mm = '1.6': input should be less than or equal to 1.5"),
        (["depth_mm=0"], "--set: depth_mm = '0': input should be greater than 0"),
        (["depth_mm=nan"], "--set: depth_mm = 'nan': input should be a finite number"),
        (["depth_mm=-inf"], "--set: depth_mm = '-inf': input should be"),
        (["times=2", "times=3"], "--set 'times=3': times is given twice"),
        (["times"], "--set 'times': expected KEY=VALUE"),
        (["times="], "--set 'times=': expected KEY=VALUE"),
        (["=3"], "--set '=3': expected KEY=VALUE"),
    ],
)
def test_set_errors(tmp_path: Path, assignments: list[str], complaint: str) -> None:
    assert _load_complaint(_write(tmp_path, SCRIPT), *assignments).startswith(complaint)


def test_a_choice_lists_what_there_is() -> None:
    text = _load_complaint("steps", "step=2")
    assert "step = '2': input should be '1', '3' or '5'" in text


# --- the check before anything moves ---


READY = "rig.mount('bar:3.0'); rig.home(); rig.zero(); rig.move_to(x_mm=0.0); "


def _script(folder: Path, body: str) -> Script:
    return load_script(str(_write(folder, f"def run(rig):\n    {body}\n")))


def _plan_complaint(folder: Path, finger: Fingertip, body: str, **tables: object) -> str:
    script = _script(folder, body)
    with pytest.raises(BadInputError) as caught:
        make_plan(script, Config.model_validate(tables), finger)
    text = str(caught.value)
    assert "\n" not in text
    where = f"{script.path}, line 2: "
    assert text.startswith(where)
    return text.removeprefix(where)


@pytest.mark.parametrize(
    ("body", "complaint"),
    [
        ("rig.zero()", "zero: home() must come first"),
        ("rig.move_to(x_mm=0.0)", "move_to: home() must come first"),
        ("rig.retract()", "retract: home() must come first"),
        ("rig.home(); rig.indent(doi_mm=0.5)", "indent: mount() must come first"),
        ("rig.mount('bar:3.0'); rig.home(); rig.indent(doi_mm=0.5)", "indent: zero() must come first"),
        ("rig.mount('bar:3.0'); rig.home(); rig.zero(); rig.indent(doi_mm=0.5)", "indent: move_to() must come first"),
        ("rig.home(); rig.move_to(x_mm=6.5)", "move_to: x_mm = 6.5 is outside limits.x_mm = -6 … 6"),
        ("rig.home(); rig.move_to(x_mm=float('nan'))", "move_to: x_mm = nan is outside limits.x_mm = -6 … 6"),
        ("rig.mount('tube:3')", "shape 'tube:3'"),
        ("rig.mount('bar:wide')", "shape 'bar:wide'"),
        ("rig.note(3)", "note: expected text, got 3"),
        (READY + "rig.indent(doi_mm=1, force_gwt=1)", "indent: expected either doi_mm or force_gwt"),
        (READY + "rig.indent()", "indent: expected either doi_mm or force_gwt"),
        (READY + "rig.indent(doi_mm=-0.1)", "indent: doi_mm = -0.1: expected a positive number"),
        (READY + "rig.indent(force_gwt=float('nan'))", "indent: force_gwt = nan: expected a positive number"),
        (READY + "rig.indent(doi_mm=0.5, increments=0)", "indent: increments = 0: expected a whole number, 1 … 100"),
        (READY + "rig.indent(doi_mm=0.5, increments=2.5)", "indent: increments = 2.5: expected a whole number"),
        (READY + "rig.indent(doi_mm=0.5, hold_s=-1)", "indent: hold_s = -1: expected 0 … 3600 s"),
        (READY + "rig.indent(doi_mm=0.5, hold_s=float('nan'))", "indent: hold_s = nan: expected 0 … 3600 s"),
        (READY + "rig.indent(doi_mm=0.5, speed_mm_s=6)", "indent: speed_mm_s = 6: expected 0.017 … 5 mm/s"),
        (READY + "rig.indent(doi_mm=0.5, speed_mm_s=0)", "indent: speed_mm_s = 0: expected 0.017 … 5 mm/s"),
        (
            READY + "rig.indent(doi_mm=1.6)",
            "indent: doi_mm = 1.6 is beyond limits.max_doi_mm = 1.5",
        ),
        (READY + "rig.indent(force_gwt=1e4)", "indent: force_gwt = 10000 is beyond limits.max_force_gwt = 100"),
        (READY + "rig.jump()", "AttributeError: 'Rig' object has no attribute 'jump'"),
    ],
)
def test_a_step_that_cannot_be_done_is_named(tmp_path: Path, finger: Fingertip, body: str, complaint: str) -> None:
    assert _plan_complaint(tmp_path, finger, body).startswith(complaint)


def test_past_the_patch(tmp_path: Path, finger: Fingertip) -> None:
    body = READY.replace("x_mm=0.0", "x_mm=5.8") + "rig.indent(doi_mm=0.5)"
    text = _plan_complaint(tmp_path, finger, body)
    assert text.startswith("bar:3 at x = 5.8 mm: touches the skin at x = 4.10 mm, outside the patch")
    assert "patch" in text
    assert "expected a smaller depth, a position nearer the pad's centre" in text


def test_limits_of_force_and_of_travel(tmp_path: Path, finger: Fingertip) -> None:
    press = READY + "rig.indent(doi_mm=1.0)"
    text = _plan_complaint(tmp_path, finger, press, limits={"max_force_gwt": 5.0})
    assert "beyond limits.max_force_gwt = 5" in text
    text = _plan_complaint(tmp_path, finger, press, frame={"apex_z_mm": -39.5})
    assert text.startswith("machine z = -40.5")
    assert text.endswith("is outside the stage's travel, -40 … 0 mm")
    text = _plan_complaint(tmp_path, finger, press, frame={"pad_centre_x_mm": -70.0})
    assert text == "machine x = -70.000 mm is outside the stage's travel, -60 … 0 mm"


@pytest.mark.parametrize(
    ("habit", "body", "complaint"),
    [
        (
            "press_speed_mm_s",
            "rig.indent(doi_mm=0.3)",
            "indent: habits.press_speed_mm_s = 1.5: expected 0.017 … 1 mm/s",
        ),
        ("approach_speed_mm_s", "rig.indent(doi_mm=0.3)", "indent: habits.approach_speed_mm_s = 1.5: expected"),
        ("approach_speed_mm_s", "rig.touch()", "touch: habits.approach_speed_mm_s = 1.5: expected 0.017 … 1 mm/s"),
        ("press_speed_mm_s", "rig.reference(x_mm=0.0, doi_mm=0.3)", "reference: habits.press_speed_mm_s = 1.5"),
    ],
)
def test_every_speed_is_checked(tmp_path: Path, finger: Fingertip, habit: str, body: str, complaint: str) -> None:
    """Of settings that no file gave, since a file with these is refused."""
    config = Config()
    habits = config.habits.model_copy(update={habit: 1.5})
    limits = config.limits.model_copy(update={"max_press_speed_mm_s": 1.0})
    config = config.model_copy(update={"habits": habits, "limits": limits})
    script = _script(tmp_path, READY + body)
    with pytest.raises(BadInputError) as caught:
        make_plan(script, config, finger)
    assert complaint in str(caught.value)
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
    """The default finger on elements twice as large."""
    return Fingertip.load(FingertipConfig(mesh=MeshSpec(spacing_mm=0.34)))


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
