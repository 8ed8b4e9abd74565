"""Mistakes of a configuration or a script: on_step before anything moves, in the words of whoever made them."""

import json
import signal
import sys
from collections.abc import Iterable
from pathlib import Path

import pytest
from pydantic import BaseModel, ValidationError

from rig.bench.checks import bench_problems
from rig.cli import main
from rig.errors import BadInputError, first_problem
from rig.plan.config import Config, keys, load_config
from rig.plan.plan import make_plan
from rig.protocol.script import load_script
from sim.models.fingertip import Fingertip

READY = "rig.mount('bar:3.0'); rig.home(); rig.zero(); rig.move_to(x_mm=0.0)"


def _complaint(folder: Path, finger: Fingertip, body: str, **tables: object) -> str:
    path = folder / "mine.py"
    path.write_text(f"import time\ndef run(rig):\n    {READY}\n    {body}\n", encoding="utf-8")
    with pytest.raises(BadInputError) as refused:
        make_plan(load_script(str(path)), Config.model_validate(tables), finger)
    return str(refused.value).removeprefix(f"{path}, ")


@pytest.mark.parametrize(
    ("body", "named"),
    [
        ("rig.tare()", ["tare", "mount", "move_to"]),
        ("rig.ident(doi_mm=0.2)", ["ident", "rig.indent"]),
        (
            "rig.indent(depth_mm=0.2)",
            ["depth_mm", "rig.indent(doi_mm=, force_gwt=, increments=, speed_mm_s=, hold_s=)"],
        ),
        ("rig.move_to(0.5)", ["rig.move_to(x_mm=, along_mm=)"]),
        ("rig.mount()", ["rig.mount(indentor)"]),
        ("rig.rest()", ["rig.rest(seconds)"]),
    ],
)
def test_a_mistake_of_a_script_is_told_with_the_verbs_there_are(
    tmp_path: Path, finger: Fingertip, body: str, named: list[str]
) -> None:
    said = _complaint(tmp_path, finger, body)
    assert said.startswith("line 4: ")
    assert [word for word in named if word not in said] == []


@pytest.mark.parametrize("name", ["indent", "nothing"])
def test_a_mistake_with_something_else_is_told_in_pythons_words(tmp_path: Path, finger: Fingertip, name: str) -> None:
    """Although a rig has a verb of that name."""
    words = f"AttributeError: 'list' object has no attribute {name!r}"
    assert _complaint(tmp_path, finger, f"[].{name}()") == f"line 4: {words}"
    words = f"TypeError: Rig.{name}s() is on_step by the script itself"
    assert _complaint(tmp_path, finger, f"raise TypeError({words[11:]!r})") == f"line 4: {words}"


@pytest.mark.parametrize(
    ("text", "key", "near"),
    [
        ("[limits]\nmax_dio_mm = 1.0\n", "limits.max_dio_mm", ["max_doi_mm"]),
        ("[limit]\nmax_doi_mm = 1.0\n", "limit", ["limits"]),
        ("[stage]\nclearance_mm = 1.0\n", "stage.clearance_mm", ["habits.clearance_mm", "limits.search_mm"]),
        ("[stage.drives.x]\ndevice_id = 1\nprot = 'a'\n", "stage.drives.x.prot", ["port"]),
        ("[stage]\nqqqqqq = 1\n", "stage.qqqqqq", []),
        (
            "[finger]\nstiffness = 1.2\n",
            "finger.stiffness",
            ["finger.tissue.stiffness", "finger.geometry.stiffness_of_fit"],
        ),
        # two at most, of its own table and of the others
        ("[calibration]\ny_steps_permm = 1\n", "calibration.y_steps_permm", ["y_steps_per_mm", "z_steps_per_mm"]),
        (
            "[limits]\nspeed_mm = 1\n",
            "limits.speed_mm",
            ["habits.press_speed_mm_s", "habits.travel_speed_mm_s"],
        ),
    ],
)
def test_an_unknown_key_is_told_with_its_neighbours(tmp_path: Path, text: str, key: str, near: list[str]) -> None:
    (tmp_path / "rig.toml").write_text(text, encoding="utf-8")
    with pytest.raises(BadInputError) as refused:
        load_config(tmp_path / "rig.toml")
    place, _, line = str(refused.value).removeprefix(f"config {tmp_path / 'rig.toml'}: ").partition(": ")
    assert place == key
    known = {key.place for key in keys(Config())} | {key.name for key in keys(Config())} | {"limits", "port"}
    assert [word.strip("?,") for word in line.split() if word.strip("?,") in known] == near


def test_the_depth_limit_that_binds_is_named(tmp_path: Path, finger: Fingertip) -> None:
    """The model answers to 2 mm; what the script may not pass is the configuration's limit."""
    tables = {"limits": {"max_force_gwt": 500, "max_doi_mm": 0.5, "soft_trip_n": 5.0}}
    said = _complaint(tmp_path, finger, "rig.indent(force_gwt=500)", **tables)
    assert said.startswith("line 4: indent: force_gwt = 500 ")
    assert said.endswith("limits.max_doi_mm = 0.5")


# --- how long it may think: tests/rig/test_patience.py ---


@pytest.mark.skipif(not hasattr(signal, "SIGALRM"), reason="needs alarms (POSIX)")
def test_what_the_model_takes_is_no_silence_of_the_script(
    tmp_path: Path, finger: Fingertip, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No alarm is set while the model is asked."""
    indent, in_the_model = Fingertip.indent, list[float]()

    def watched(*arguments: object, **more: object) -> object:
        in_the_model.append(signal.getitimer(signal.ITIMER_REAL)[0])
        return indent(*arguments, **more)  # type: ignore[arg-type]

    monkeypatch.setattr(Fingertip, "indent", watched)
    path = tmp_path / "mine.py"
    path.write_text(f"def run(rig):\n    {READY}\n    rig.indent(doi_mm=0.2)\n", encoding="utf-8")
    counted: list[int] = []
    plan = make_plan(load_script(str(path)), Config(), finger, on_step=counted.append)
    assert len(plan.indentations) == 1
    assert counted == [1, 2, 3, 4, 5]
    assert in_the_model
    assert set(in_the_model) == {0.0}


# --- what no bench can be ---

BENCHES = {
    "one port": (
        "[stage]\nport = '/dev/one'\n[force]\nport = '/dev/one'\n",
        "same_port", "stage.port and force.port", "/dev/one",
    ),
    "one device under two names": (
        "[stage]\nport = 'link'\n[force]\nport = 'device'\n", "same_port", "stage.port and force.port", "link"),
    "a drive's port": (
        "[stage]\nkind='leadshine'\n[stage.drives.z]\ndevice_id=2\nport = '/dev/two'\n[force]\nport = '/dev/two'\n",
        "same_port", "stage.port and force.port", "/dev/two",
    ),
    "the apex too low": ("[frame]\napex_z_mm = -45.0\n", "outside_travel", "frame.apex_z_mm = -45", "-40 … 0 mm"),
    "the apex above the switch": (
        "[frame]\napex_z_mm = 1.0\n", "outside_travel", "frame.apex_z_mm = 1", "-40 … 0 mm"),
    "no room for clearance": ("[frame]\napex_z_mm = -1.0\n", "outside_travel", "frame:", " z = 1.300 mm "),
    "beside the pad": ("[frame]\npad_centre_x_mm = -70.0\n", "outside_travel", "frame:", " x = -70.000 mm "),
}  # fmt: skip


class Part(BaseModel, extra="forbid"):
    depth_mm: float = 1.0


class Whole(BaseModel, extra="forbid"):
    parts: list[Part] = []


def test_an_unknown_key_in_a_list_of_tables_is_told_with_its_neighbours() -> None:
    with pytest.raises(ValidationError) as found:
        Whole.model_validate({"parts": [{}, {"dept_mm": 2.0}]})
    said = str(first_problem("mine", found.value, Whole))
    assert said.startswith("mine: parts.1.dept_mm: ")
    assert " depth_mm" in said


@pytest.mark.parametrize("name", BENCHES)
def test_what_no_bench_can_be_is_told(
    tmp_path: Path, finger: Fingertip, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    """By doctor, which goes on, and by check and run, which refuse."""
    text, coded, where, named = BENCHES[name]
    monkeypatch.chdir(tmp_path)
    (tmp_path / "device").touch()
    (tmp_path / "link").symlink_to("device")
    (tmp_path / "rig.toml").write_text(text, encoding="utf-8")

    def there(problems: Iterable[str]) -> bool:
        return any(problem.startswith(f"{where} ") and named in problem for problem in problems)

    assert there(bench_problems(load_config(Path("rig.toml"))))

    def ended(*arguments: str) -> tuple[int, dict[str, object]]:
        monkeypatch.setattr(sys, "argv", ["rig", *arguments, "--config", "rig.toml", "--json"])
        with pytest.raises(SystemExit) as caught:
            main()
        return int(caught.value.code or 0), json.loads(capsys.readouterr().out)

    code, doctor = ended("doctor")
    problems = doctor["problems_text"]
    assert code == 0
    assert isinstance(problems, list)
    assert there(problems)
    for command in (["check", "first_press"], ["run", "first_press"]):
        code, refused = ended(*command)
        assert (code, refused["code"], refused["error_text"]) == (2, coded, problems[0])


def test_the_defaults_are_a_bench() -> None:
    assert bench_problems(Config()) == []
