"""Presses ordered by Bluesky: documents equal the journal, and no promise of safety is lost on the way."""

import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, nullcontext
from pathlib import Path
from typing import Any

import pytest

import rig.bluesky
from rig.bench.served import ServedBench
from rig.bluesky import ROWS, STREAM_NAMES, BlueskyBench, OrderStatus, PressFailedError, indent, press
from rig.control.client import Announced, ControlError, announced
from rig.data import read_run
from rig.data.run import Following
from rig.transport import open_port
from tests.preloaded import Popen
from tests.program import WHOLE
from tests.waiting import until

pytest.importorskip("pty", reason="needs pseudo-terminals and signals")
bluesky = pytest.importorskip("bluesky", reason="needs bluesky (extra bluesky)")

PRESS = {"indentor": "bar:3.0", "x_mm": (0.0, 0.5), "force_gwt": 2.33, "presses": 2, "increments": 2, "hold_s": 2.0}
HELD = {"indentor": "bar:3.0", "force_gwt": 2.33, "hold_s": 60.0, "speed": 50.0, "virtual": True}
"""A press that is held for more than a second, so that something happens meanwhile."""
Documents = list[tuple[str, Mapping[str, Any]]]


class Engine:
    """A run engine outside of the main thread's signals, and its documents."""

    def __init__(self) -> None:
        self.documents: Documents = []
        self.engine = bluesky.RunEngine({}, context_managers=[])
        self.engine.subscribe(lambda name, document: self.documents.append((name, document)))

    def __call__(self, plan: Any) -> None:
        self.engine(plan)

    def failure(self, plan: Any) -> tuple[Any, str]:
        """The code with which a plan fails, in its FailedStatus, and how its run ended."""
        with pytest.raises(bluesky.utils.FailedStatus) as failed:
            self.engine(plan)
        (status,) = failed.value.args
        stops = [document["exit_status"] for name, document in self.documents if name == "stop"]
        return status.exception().code, stops[-1]


@pytest.fixture(scope="module", autouse=True)
def _begun_at_once() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(subprocess, "Popen", Popen)
        patch.setattr(rig.bluesky, "PROGRAM", [WHOLE])
        yield


@pytest.fixture
def ports() -> Iterator[tuple[str, str]]:
    """Names of two ports at which nothing answers."""
    ends = [*os.openpty(), *os.openpty()]
    yield os.ttyname(ends[1]), os.ttyname(ends[3])
    for end in ends:
        os.close(end)


@pytest.fixture
def engine() -> Engine:
    return Engine()


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[BlueskyBench]:
    """A bench that is left at the end, after refused orders and presses."""
    with BlueskyBench(**PRESS, virtual=True, out=tmp_path_factory.mktemp("runs")) as bench:
        yield bench
    run = read_run(bench.folder.path)
    assert run.stop is not None
    assert (run.stop["status"], run.complete) == ("done", True)
    assert bench.folder.report.exists()


def _events(documents: Documents) -> dict[str, list[Mapping[str, Any]]]:
    """Event documents by the name of their stream."""
    names = {one["uid"]: one["name"] for name, one in documents if name == "descriptor"}
    found: dict[str, list[Mapping[str, Any]]] = {}
    for name, one in documents:
        if name == "event":
            found.setdefault(names[one["descriptor"]], []).append(one)
    return found


def _of(journal: Sequence[Mapping[str, Any]], stream: str) -> list[Mapping[str, Any]]:
    return [one for one in journal if one["doc"] == "event" and one["stream"] == stream]


def test_documents_equal_the_journal_number_by_number(shared: BlueskyBench, engine: Engine) -> None:
    engine(indent(shared, force_gwt=2.0, x_mm=0.5, increments=2, hold_s=0.5, md={"sample": "finger 1"}))
    start = engine.documents[0][1]
    journal = Following(shared.folder).new()
    assert (start["rig_run"], start["rig_journal"]) == (shared.folder.path.name, journal[0]["uid"])
    assert (start["plan_name"], start["sample"]) == ("indent", "finger 1")
    (index,) = [one["data"]["index"] for one in _of(journal, "indentation_start")][-1:]
    found = _events(engine.documents)
    assert set(found) == set(STREAM_NAMES.values())
    for stream, columns in ROWS.items():
        rows = [one for one in _of(journal, stream) if one["data"]["index"] == index]
        events = found[STREAM_NAMES[stream]]
        assert len(events) == len(rows) > 0
        for event, row in zip(events, rows, strict=True):
            values = {**row["data"], "t_s": row["t_s"]}
            expected = {
                f"rig_{stream}_{one.name}": values[one.name] for one in columns if values[one.name] is not None
            }
            given = {key: value for key, value in event["data"].items() if value == value}
            assert given == expected
            assert set(event["timestamps"].values()) == {row["unix_s"]}
    assert engine.documents[-1][1]["exit_status"] == "success"


def test_a_plan_of_bluesky_moves_the_stage_and_reads_the_cell(shared: BlueskyBench, engine: Engine) -> None:
    plans = pytest.importorskip("bluesky.plans")
    engine(plans.list_scan([shared.cell], shared.stage, [0.5, 0.0]))
    (events,) = _events(engine.documents).values()
    assert [one["data"]["rig_stage_x_mm"] for one in events] == [0.5, 0.0]
    assert all(isinstance(one["data"]["rig_cell_force_gwt"], float) for one in events)
    moves = [one["data"]["x_mm"] for one in _of(Following(shared.folder).new(), "move")]
    assert moves[-2:] == [0.5, 0.0]


@pytest.mark.parametrize("device", ["stage", "press"])
def test_devices_have_the_protocols(shared: BlueskyBench, device: str) -> None:
    from bluesky import protocols

    movable = getattr(shared, device)
    for protocol in (protocols.Movable, protocols.Readable, protocols.Stoppable, protocols.Configurable):
        assert isinstance(movable, protocol)
    assert isinstance(shared.cell, protocols.Readable)
    assert isinstance(movable.set(7.0 if device == "stage" else {}), protocols.Status)


# --- every promise that a second way to press could break ---

REFUSED_BEFORE = {
    "confirmation": ({}, "no_terminal"),
    "limit of the force": ({"force_gwt": 1e4, "options": ("--yes", "--mounted=bar:3.0")}, "beyond_limit"),
    "a person mounts": ({"options": ("--yes",)}, "mount_by_hand"),
    "owner lock": ({"options": ("--yes", "--mounted=bar:3.0")}, "in_use"),
}
"""What is refused before a port is written to: further options of the bench, and the code."""

REFUSED_ORDERS = {
    "confirmed force": ({"force_gwt": 2.34}, "not_confirmed"),
    "confirmed target": ({"doi_mm": 0.1}, "another_target"),
    "confirmed position": ({"force_gwt": 1.0, "x_mm": 0.25}, "another_position"),
    "confirmed hold": ({"force_gwt": 1.0, "hold_s": 3.0}, "not_confirmed"),
    "confirmed increments": ({"force_gwt": 1.0, "increments": 3}, "not_confirmed"),
    "a number": ({"force_gwt": -1.0}, "not_confirmed"),
    "no other key": ({"force_gwt": 1.0, "speed_mm_s": 9.0}, "unknown_key"),
}
"""What is refused as an order, while the run waits on: the order, and the code."""


def _stopped_elsewhere(bench: BlueskyBench, engine: Engine) -> None:
    (one,) = (one for one in announced() if one.run == str(bench.folder.path))
    one.post_stop()(60.0)


def _aborted(bench: BlueskyBench, engine: Engine) -> None:
    engine.engine.abort()


def _paused(bench: BlueskyBench, engine: Engine) -> None:
    engine.engine.request_pause()


ENDED = {
    "force limit": ("stiffness = 8.0", "next_move_past_soft_trip", "limited"),
    "trip": ("finger_z_offset_mm = -2.0", "no_contact", "tripped"),
    "STOP from elsewhere": (_stopped_elsewhere, "stopped_at_once", "aborted"),
    "RE.abort": (_aborted, None, "aborted"),
    "RE.request_pause": (_paused, None, "aborted"),
}
"""What ends a press (another virtual finger, or an act during its hold), the code, and how the journal ends."""


@pytest.mark.parametrize("promise", [*REFUSED_BEFORE, *REFUSED_ORDERS, *ENDED])
def test_no_promise_is_lost_below_bluesky(
    promise: str, engine: Engine, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    if promise in REFUSED_BEFORE:
        more, code = REFUSED_BEFORE[promise]
        stage, force = request.getfixturevalue("ports")
        config = request.getfixturevalue("rig_toml")(stage, force)
        with closing(open_port(stage, 115200)) if promise == "owner lock" else nullcontext():
            bench = BlueskyBench(config, **{**PRESS, "out": tmp_path / "runs", **more})
            with pytest.raises(PressFailedError) as refused, bench:
                pass
        assert refused.value.code == code
        assert not list((tmp_path / "runs").glob("*/events.jsonl"))
    elif promise in REFUSED_ORDERS:
        shared: BlueskyBench = request.getfixturevalue("shared")
        order, code = REFUSED_ORDERS[promise]
        before = len(shared.journalled)
        assert engine.failure(indent(shared, **order)) == (code, "fail")
        assert len(shared.journalled) == before
    else:
        _ends(*ENDED[promise], engine, tmp_path)


def _ends(
    act: Callable[[BlueskyBench, Engine], None] | str, code: str | None, status: str, engine: Engine, at: Path
) -> None:
    config = at / "rig.toml"
    finger = act if isinstance(act, str) else ""
    config.write_text(f"[virtual]\n{finger}\n", encoding="utf-8")
    target = {"doi_mm": 1.0, "hold_s": 2.0} if finger else {"force_gwt": 2.33, "hold_s": 60.0}
    options: dict[str, Any] = {"indentor": "bar:3.0", **target, "virtual": True} if finger else HELD
    with BlueskyBench(config, **options, out=at / "runs") as bench:
        if not isinstance(act, str):
            during = threading.Thread(target=_during_the_hold, args=(act, bench, engine))
            during.start()
        plan = indent(bench, **target)
        if code is None:
            with pytest.raises(bluesky.utils.RunEngineInterrupted):
                engine(plan)
            if engine.engine.state == "paused":
                engine.engine.abort()
        else:
            assert engine.failure(plan) == (code, "fail")
            assert engine.failure(indent(bench, **target)) == (code, "fail")  # until a new bench
        if not isinstance(act, str):
            during.join()
    run = read_run(bench.folder.path)
    assert run.stop is not None
    assert run.stop["status"] == status
    assert run.done == {}
    if code is None:
        _ended_lifted(bench)
    else:
        begins_s = run.stream("indentation_start")[0]["t_s"]
        journalled = [one["force_gwt"] for one in run.stream("sample") if one["t_s"] > begins_s]
        samples = _events(engine.documents)["samples"]
        assert [one["data"]["rig_sample_force_gwt"] for one in samples] == journalled


def _ended_lifted(bench: BlueskyBench) -> None:
    """The run of a bench that was left has ended at a safe point, lifted, from a hold."""
    refused = bench.press.set({"force_gwt": 2.33}).exception()
    assert getattr(refused, "code", None) == "stopped_at_a_safe_point"
    streams = [one["stream"] for one in bench.journalled if one["doc"] == "event"]
    assert "hold_end" not in streams
    assert streams[len(streams) - streams[::-1].index("hold_start") :].count("retract") == 1
    (lifted,) = _of(bench.journalled, "retract")[-1:]
    assert lifted["data"]["height_mm"] == pytest.approx(2.0, abs=0.01)


class Broken:
    """A device of another kind that raises."""

    name, parent = "other", None

    def trigger(self) -> None:
        raise RuntimeError("the detector does not answer")


def _raises_in_the_with_block(bench: BlueskyBench, engine: Engine) -> None:
    bench.press.set({"force_gwt": 2.33, "hold_s": 60.0})
    until(lambda: _of(bench.journalled, "hold_start"))
    raise RuntimeError("the detector does not answer")


def _the_plan_ends(bench: BlueskyBench, engine: Engine) -> None:
    engine(_pressing(bench, lambda stubs: stubs.null()))


def _pressing(bench: BlueskyBench, then: Callable[[Any], Any]) -> Any:
    """A press that the plan does not wait for, and what else the plan does in its hold."""
    from bluesky import plan_stubs as stubs

    yield from stubs.abs_set(bench.press, {"force_gwt": 2.33, "hold_s": 60.0}, group="press")
    while not _of(bench.journalled, "hold_start"):
        yield from stubs.sleep(0.01)
    yield from then(stubs)


@pytest.mark.parametrize(
    ("act", "raises"),
    [
        (_raises_in_the_with_block, "the detector does not answer"),
        (_the_plan_ends, ""),
    ],
)
def test_a_plan_that_ends_in_a_press_leaves_the_finger_lifted(
    act: Callable[[BlueskyBench, Engine], None], raises: str, engine: Engine, tmp_path: Path
) -> None:
    """The lab's own code raises, or the plan does not wait."""
    ended = pytest.raises(RuntimeError, match=raises) if raises else nullcontext()
    with ended, BlueskyBench(**HELD, out=tmp_path / "runs") as bench:
        act(bench, engine)
    _ended_lifted(bench)


def test_a_failure_of_another_device_ends_the_press_that_waits() -> None:
    bench, ended = BlueskyBench(**PRESS), list[object]()
    bench.press.stop = lambda **more: ended.append(more)  # type: ignore[method-assign]
    messages = press(bench, force_gwt=1.0)
    next(messages)
    with pytest.raises(bluesky.utils.FailedStatus):
        messages.throw(bluesky.utils.FailedStatus(OrderStatus()))
    assert len(ended) == 1


def test_an_exception_between_presses_leaves_the_finger_lifted_and_the_run_ready_for_the_confirmed_presses(
    engine: Engine, tmp_path: Path
) -> None:
    with BlueskyBench(**PRESS, virtual=True, out=tmp_path / "runs") as bench:

        def plan() -> Any:
            from bluesky import plan_stubs as stubs

            yield from indent(bench, force_gwt=1.0)
            yield from stubs.trigger(Broken())

        with pytest.raises(RuntimeError, match="does not answer"):
            engine(plan())
        (lifted,) = _of(bench.journalled, "retract")[-1:]
        assert lifted["data"]["height_mm"] == pytest.approx(2.0, abs=0.01)
        engine(indent(bench, force_gwt=1.0))
        assert engine.failure(indent(bench, force_gwt=1.0)) == ("too_many_presses", "fail")
    run = read_run(bench.folder.path)
    assert run.stop is not None
    assert run.stop["status"] == "done"


def _during_the_hold(act: Callable[[BlueskyBench, Engine], None], bench: BlueskyBench, engine: Engine) -> None:
    until(lambda: _of(bench.journalled, "hold_start"))
    act(bench, engine)


@pytest.mark.parametrize("pressing", [False, True])
def test_a_run_that_ends_by_itself_is_not_terminated(
    pressing: bool, engine: Engine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where signals cannot be handled, a termination would cost the end of its journal."""
    terminated = list[object]()
    with BlueskyBench(**HELD, out=tmp_path / "runs") as bench:
        monkeypatch.setattr(bench._process, "terminate", lambda: terminated.append(0))
        if pressing:
            during = threading.Thread(target=_during_the_hold, args=(_ended_unseen, bench, engine))
            during.start()
            bench.press.set({"force_gwt": 2.33, "hold_s": 60.0})
            during.join()
            monkeypatch.setattr(Announced, "post_stop", _no_answer)
        else:
            _ended_unseen(bench, engine)
        monkeypatch.setattr(Announced, "ask", _no_answer)
    run = read_run(bench.folder.path)
    assert terminated == []
    assert run.stop is not None


def _ended_unseen(bench: BlueskyBench, engine: Engine) -> None:
    (one,) = (one for one in announced() if one.run == str(bench.folder.path))
    one.post_stop()


def _no_answer(one: Announced, *request: Any, **more: Any) -> None:
    raise ControlError(f"process {one.pid} has ended", "ended")


def test_an_order_whose_reply_a_stop_overtakes_says_why_the_run_has_ended(
    engine: Engine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with BlueskyBench(**HELD, out=tmp_path / "runs") as bench:

        def overtaken(one: Announced, *request: Any, **more: Any) -> None:
            _stopped_elsewhere(bench, engine)
            _no_answer(one)

        monkeypatch.setattr(Announced, "ask", overtaken)
        ended = bench.press.set({"force_gwt": 2.33, "hold_s": 60.0}).exception(0.0)
    assert getattr(ended, "code", None) == "stopped_at_once"


GIVES_ORDERS = f"""\
import signal, subprocess, sys
import rig.bluesky
from rig.bluesky import BlueskyBench
from tests.preloaded import Popen

subprocess.Popen, rig.bluesky.PROGRAM = Popen, [{WHOLE!r}]
with BlueskyBench(indentor="bar:3.0", force_gwt=1.0, virtual=True, out=sys.argv[1]) as bench:
    print(bench._process.pid, flush=True)
    signal.pause()
"""


@pytest.mark.parametrize(("code", "stops"), [("no_reply", 1), ("not_confirmed", 0)])
def test_an_order_without_a_reply_is_stopped_since_it_may_have_begun(code: str, stops: int) -> None:
    """And none that was refused. Its status has ended, so that no stop of an order would reach it any more."""
    said: list[str] = []

    class Owner:
        def ask(self, do: str, **order: Any) -> None:
            raise ControlError("no", code)

        def post_stop(self) -> Callable[[float], object]:
            said.append("stop")
            return lambda within_s: {}

    class Process:
        def poll(self) -> None:
            """It lives."""

    bench = BlueskyBench(**PRESS)
    bench._owner, bench._process = Owner(), Process()  # type: ignore[assignment]
    status = bench.press.set({"force_gwt": 1.0})
    problem = status.exception()
    assert (getattr(problem, "code", None), len(said)) == (code, stops)


def test_a_run_ends_with_the_program_that_orders(tmp_path: Path) -> None:
    process = subprocess.Popen([sys.executable, "-c", GIVES_ORDERS, tmp_path], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    pid = int(process.stdout.readline())
    process.kill()
    process.communicate()
    (folder,) = tmp_path.iterdir()
    until(lambda: (run := read_run(folder)).stop is not None and run.stop["status"] == "done")
    until(lambda: not _lives(pid))


def _lives(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def test_a_press_on_real_wires(whole: tuple[ServedBench, Path], engine: Engine, tmp_path: Path) -> None:
    _, config = whole
    options = ["--yes", "--mounted=bar:3.0"]
    with BlueskyBench(
        config, indentor="bar:3.0", force_gwt=1.0, hold_s=0.2, out=tmp_path / "runs", options=options
    ) as bench:
        (one,) = (one for one in announced() if one.run == str(bench.folder.path))
        assert not one.virtual
        assert len(one.ports) == 2
        engine(indent(bench, force_gwt=1.0, hold_s=0.2))
    run = read_run(bench.folder.path)
    assert run.complete
    assert run.start["virtual"] is False
    (hold,) = _events(engine.documents)["primary"]
    assert hold["data"]["rig_hold_end_force_gwt"] == run.stream("hold_end")[0]["force_gwt"]
    assert hold["data"]["rig_hold_end_force_gwt"] == pytest.approx(1.0, abs=0.05)
