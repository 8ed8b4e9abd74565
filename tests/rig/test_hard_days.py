"""What must not go wrong on a bad day: dead sensors, pulled wires, stiff things, odd scripts and files."""

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from rig.data import read_run
from rig.devices.base import ForceReading, StageAlarm
from rig.engine import LimitError, NotReadyError, RunAborted, Target, TripError, indent, verbs
from rig.engine.engine import State
from rig.errors import BadInputError
from rig.plan.config import Config, load_config
from rig.plan.plan import make_plan
from rig.protocol.script import load_script
from rig.transport import TransportError
from rig.units import GWT_N
from tests.error_codes import raises

Make = Callable[..., Any]
FORCE = Target("force_gwt", 2.33)


def _at_first(bench: Any, phase: str, act: Callable[[], object]) -> None:
    left = [act]

    def look(stream: str, data: Mapping[str, Any]) -> None:
        if left and stream == "sample" and data["phase"] == phase:
            left.pop()()

    bench.on_event = look


# 1
@pytest.mark.parametrize("force_n", [math.nan, math.inf, -math.inf])
def test_a_reading_that_is_not_a_number_trips(spring: Make, monkeypatch: pytest.MonkeyPatch, force_n: float) -> None:
    bench = spring()
    engine = bench.ready()
    bad = ForceReading(force_n, True, 0.0)
    _at_first(bench, "press", lambda: monkeypatch.setattr(engine.sensing.sensor, "read", lambda: bad))
    with raises(TripError, "not_a_number") as tripped:
        indent(engine, FORCE)
    assert tripped.value.fields["force_n"] is force_n
    assert bench.of("trip")
    assert engine.state is State.TRIPPED
    assert bench.height_mm == pytest.approx(2.0, abs=0.002)


# 2
def test_an_operators_stop_does_not_wait_for_the_hold(spring: Make) -> None:
    bench = spring()
    engine = bench.ready()
    bench.interrupt = lambda: any(e["phase"] == "hold" for e in bench.of("sample"))
    with raises(RunAborted, "stopped_at_a_safe_point"):
        indent(engine, FORCE, hold_s=600.0)
    assert sum(e["phase"] == "hold" for e in bench.of("sample")) <= 2
    assert bench.of("hold_end") == []


# 3
def test_a_trip_stays_latched_when_the_lift_fails(spring: Make) -> None:
    bench = spring(k_gwt=4000.0, soft_trip_n=0.02)
    engine = bench.ready()

    def look(stream: str, data: Mapping[str, Any]) -> None:
        if stream == "trip":
            bench.stage_line.device_write(b"ALARM:1\r\n")

    bench.on_event = look
    with pytest.raises((TripError, StageAlarm)):
        indent(engine, FORCE)
    assert engine.state is State.TRIPPED
    with raises(NotReadyError, "tripped"):
        verbs.home(engine)


# 4
def test_a_silent_balance_is_a_trip(spring: Make) -> None:
    bench = spring()
    engine = bench.ready()
    _at_first(bench, "press", lambda: setattr(bench.balance, "mute", True))
    with raises(TripError, "no_reading", error_code="no_reply"):
        indent(engine, FORCE)
    assert engine.state is State.TRIPPED


# 5
@pytest.mark.parametrize("which", ["force", "stage"])
def test_an_unplugged_wire_stops_the_stage(spring: Make, which: str) -> None:
    bench = spring()
    engine = bench.ready()
    device = engine.sensing.sensor if which == "force" else engine.bench.stage
    _at_first(bench, "press", lambda: device._transport.close())
    closed = {"port": "stage"} if which == "stage" else {"error_code": "closed"}
    kind, code = (TransportError, "closed") if which == "stage" else (TripError, "no_reading")
    with raises(kind, code, **closed):
        indent(engine, FORCE)
    assert engine.state is (State.UNHOMED if which == "stage" else State.TRIPPED)
    if which == "force":
        assert bench.height_mm == pytest.approx(2.0, abs=0.002)


# 6
def test_no_change_of_indentor_after_a_stop_in_contact(spring: Make) -> None:
    bench = spring()
    engine = bench.ready()
    engine.go_to_height(1.96, 0.5)
    engine.stop()
    with raises(NotReadyError, "may_touch", state="unhomed"):
        verbs.mount(engine, "step:1")


# 7
def test_no_indentation_where_the_switches_are(spring: Make) -> None:
    """Homing leaves the carriage outside the lateral limits."""
    bench = spring()
    engine = bench.ready()
    verbs.home(engine)
    before = len(bench.of("sample"))
    with raises(NotReadyError, "not_placed"):
        indent(engine, FORCE)
    assert len(bench.of("sample")) == before


def test_homing_forgets_where_move_to_went(tmp_path: Path, finger: Any) -> None:
    path = tmp_path / "mine.py"
    body = "rig.mount('bar:3.0'); rig.home(); rig.zero(); rig.move_to(x_mm=0.0); rig.home(); rig.indent(doi_mm=0.2)"
    path.write_text(f"def run(rig):\n    {body}\n", encoding="utf-8")
    with raises(BadInputError, "comes_too_early", verb="indent", before="move_to()"):
        make_plan(load_script(str(path)), Config(), finger)


# 8
def test_a_stiff_thing_settles_on_the_nearest_step(spring: Make) -> None:
    """One step of the stage is 0.07 gwt here: within the tolerance, though not within half of it."""
    done = indent(spring(k_gwt=47.0, contact_mm=0.21875).ready(), Target("force_gwt", 3.0), hold_s=0.1)
    assert done.holds[0].force_gwt == pytest.approx(3.0, abs=0.05)


# 9
def test_no_step_past_the_soft_trip_at_the_stiffness_last_measured(spring: Make) -> None:
    bench = spring(k_gwt=200.0, soft_trip_n=0.1)
    with raises(LimitError, "next_move_past_soft_trip", limit_gwt=0.1 / GWT_N):
        indent(bench.ready(), Target("force_gwt", 12.0), hold_s=0.1)
    assert bench.of("trip") == []


# 10
@pytest.mark.parametrize(("k_gwt", "touch_force_gwt"), [(14.0, 1.0), (0.5, 0.05)])
def test_the_fine_descent_starts_in_the_air(spring: Make, k_gwt: float, touch_force_gwt: float) -> None:
    settings = Config.model_validate({"habits": {"touch_force_gwt": touch_force_gwt}, "limits": {"search_mm": 1.0}})
    bench = spring(settings=settings, k_gwt=k_gwt)
    indent(bench.ready(), Target("doi_mm", 0.5), hold_s=0.1)
    fine = [e for e in bench.of("sample") if e["phase"] == "touch"]
    assert fine[0]["force_gwt"] == 0.0
    assert abs(bench.of("touch")[0]["true_doi_bias_mm"]) < 0.02


# 11
def test_a_depth_less_than_the_touch_took_is_lifted_to(spring: Make) -> None:
    done = indent(spring().ready(), Target("doi_mm", 0.02), hold_s=0.1)
    assert done.holds[0].doi_mm == pytest.approx(0.02, abs=0.0025)


# 12
def test_a_relative_path_has_its_line_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, finger: Any) -> None:
    monkeypatch.chdir(tmp_path)
    Path("mine.py").write_text("def run(rig):\n    rig.zero()\n", encoding="utf-8")
    with raises(BadInputError, "comes_too_early", verb="zero", before="home()") as refused:
        make_plan(load_script("mine.py"), Config(), finger)
    assert refused.value.fields["place"].endswith("mine.py, line 2")


# 13
@pytest.mark.parametrize("when", ["import", "run"])
def test_a_script_that_exits(tmp_path: Path, finger: Any, when: str) -> None:
    path = tmp_path / "mine.py"
    bodies = {"import": "import sys\nsys.exit(0)\n", "run": "import sys\ndef run(rig): sys.exit(0)\n"}
    path.write_text(bodies[when], encoding="utf-8")
    with raises(BadInputError, "exception_in_script", exception="SystemExit") as refused:
        make_plan(load_script(str(path)), Config(), finger)
    assert refused.value.fields["place"].endswith("mine.py, line 2")


# 14
def test_a_script_with_postponed_annotations(tmp_path: Path) -> None:
    path = tmp_path / "mine.py"
    path.write_text(
        "from __future__ import annotations\nfrom typing import Literal\n"
        "from rig.protocol import ProtocolParameters\n"
        "class Parameters(ProtocolParameters):\n    step: Literal['1', '3'] = '1'\ndef run(rig): pass\n",
        encoding="utf-8",
    )
    assert load_script(str(path), ["step=3"]).parameters.step == "3"


# 15
@pytest.mark.parametrize(
    "frame", [{"apex_z_mm": -1.0}, {"pad_y_mm": -50.0}], ids=["clearance above the switch", "y off the stage"]
)
def test_the_plan_looks_at_clearance_and_y(tmp_path: Path, finger: Any, frame: dict[str, float]) -> None:
    path = tmp_path / "mine.py"
    body = "rig.mount('bar:3.0'); rig.home(); rig.zero(); rig.move_to(x_mm=0.0); rig.indent(doi_mm=0.2)"
    path.write_text(f"def run(rig):\n    {body}\n", encoding="utf-8")
    with raises(BadInputError, "outside_travel", axis="z" if "apex_z_mm" in frame else "y"):
        make_plan(load_script(str(path)), Config.model_validate({"frame": frame}), finger)


def test_the_plan_knows_the_slowest_speed(tmp_path: Path, finger: Any) -> None:
    path = tmp_path / "mine.py"
    body = "rig.mount('bar:3.0'); rig.home(); rig.zero(); rig.move_to(x_mm=0.0)"
    path.write_text(f"def run(rig):\n    {body}; rig.indent(doi_mm=0.2, speed_mm_s=0.001)\n", encoding="utf-8")
    with raises(BadInputError, "outside_range", key="speed_mm_s", value=0.001):
        make_plan(load_script(str(path)), Config(), finger)


# 16
@pytest.mark.parametrize("text", ["[limits]\nx_mm = [6.0, -6.0]\n", "[stage]\ntravel_mm = [-1.0, 0.0, 5.0]\n"])
def test_ranges_that_make_no_sense(tmp_path: Path, text: str) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(BadInputError):
        load_config(path)


# 17
@pytest.mark.parametrize("rest", [b"\xff\xfe\n{}\n", b"3\n", b"{}\n", b'{"doc": "event"}\n'])
def test_a_line_of_a_journal_that_is_no_document_is_named(tmp_path: Path, rest: bytes) -> None:
    (tmp_path / "events.jsonl").write_bytes(b'{"doc": "start", "t_s": 0}\n' + rest)
    assert read_run(tmp_path).damage[0].line == 2


def test_a_torn_line_that_is_not_even_text_is_dropped(tmp_path: Path) -> None:
    (tmp_path / "events.jsonl").write_bytes(b'{"doc": "start", "t_s": 0}\n\xff\xfe')
    assert read_run(tmp_path).stop is None


# 18
def test_a_port_with_any_name_reads_back(tmp_path: Path) -> None:
    config = Config.model_validate({"stage": {"port": "/dev/\U0001f600\x7f"}})
    (tmp_path / "rig.toml").write_text(config.as_toml(), encoding="utf-8")
    assert load_config(tmp_path / "rig.toml") == config
