"""What is looked at: the owner that is shown, the run that goes on, and what pages are told of both."""

import asyncio
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rig.control.client import ControlError
from rig.data.folder import RunFolder
from rig.data.run_state import Course
from rig.panel.run_view import RunView
from rig.panel.stream import NOTHING, PageQueue
from rig.panel.watcher import ASK_S, BEAT_S, FIND_S, HAND, LOOK_S, STATUS_S, Watcher
from sim.devices.clock import VirtualClock
from tests.rig.panel.stub_panel import StubOwner, StubPanel
from tests.rig.panel.test_outlet import events

Make = Callable[..., StubPanel]


def journal(path: Path, *documents: dict[str, Any]) -> Path:
    """A run's folder; its documents are appended."""
    path.mkdir(parents=True, exist_ok=True)
    with (path / "events.jsonl").open("a", encoding="utf-8") as file:
        for n, one in enumerate(documents):
            file.write(json.dumps({"t_s": float(n), "unix_s": 1000.0 + n, **one}) + "\n")
    return path


START = {"doc": "start", "protocol": "p", "planned_indentations": 1, "virtual": True}


def sample(force_gwt: float) -> dict[str, Any]:
    return {"doc": "event", "stream": "sample", "data": {"index": 0, "phase": "press", "force_gwt": force_gwt}}


def look(watcher: Watcher) -> None:
    async def once() -> None:
        await watcher.ask()
        await watcher.read()
        await watcher.beat()

    asyncio.run(once())


def told(watcher: Watcher, client: PageQueue) -> dict[str, Any]:
    look(watcher)
    return dict(events(client.taken(0.0)))


def test_how_the_participants_button_is_is_told_where_there_is_one(make: Make, tmp_path: Path) -> None:
    run = journal(tmp_path / "run", START)
    status = {"ok": True, "state": "running", "stopped": False, "stop_button": "not pressed, tested"}
    watcher = make(StubOwner(run=str(run), answers={"status": status})).watcher
    with watcher.outlet.joined() as client:
        assert told(watcher, client)["state"]["owner"]["stop_button"] == "not pressed, tested"


def test_an_owner_s_run_is_followed_wherever_it_lies(make: Make, tmp_path: Path) -> None:
    run = journal(tmp_path / "elsewhere" / "run", START, sample(1.5))
    owner = StubOwner(run=str(run), answers={"status": {"ok": True, "state": "running", "stopped": False}})
    watcher = make(owner).watcher
    with watcher.outlet.joined() as client:
        found = told(watcher, client)
        assert found["state"]["owner"] == {
            "kind": "run", "pid": 1, "virtual": False, "ports": ["/dev/ttyUSB0", "/dev/ttyUSB1"], "state": "running",
            "stopped": False, "reachable": True,
        }  # fmt: skip
        assert found["state"]["run"]["name"] == "run"
        assert (found["state"]["newest"]["force_gwt"], found["state"]["run"]["state"]) == (1.5, "running")
        assert (found["state"]["hand"], found["state"]["notice"], found["state"]["configured"]) == (None, None, True)
        assert (found["readings"]["run"], len(found["readings"]["rows"])) == ("run", 1)
        journal(run, sample(2.5))
        assert told(watcher, client)["readings"]["rows"][0][2] == 2.5
        owner.run = str(journal(tmp_path / "other", START))
        found = told(watcher, client)
        assert (found["state"]["run"]["name"], found["readings"]["reset"]) == ("other", True)


def test_a_run_that_has_not_begun_is_no_run_and_one_that_ended_stays(make: Make, tmp_path: Path) -> None:
    run = journal(tmp_path / "run", START, sample(1.5))
    owner = StubOwner(run=str(run), answers={"status": {"ok": True, "state": "running"}})
    panel = make(owner)
    watcher = panel.watcher
    look(watcher)
    journal(run, {"doc": "stop", "status": "done"})
    panel.owners.clear()
    with watcher.outlet.joined() as client:
        state = told(watcher, client)["state"]
        assert (state["owner"], state["run"]["state"], state["run"]["now"]) == (None, "done", None)
        panel.owners.append(StubOwner(pid=2, answers={"status": {"ok": True, "state": "planning"}}))
        found = told(watcher, client)
        assert (found["state"]["run"], found["state"]["notice"]) == (
            None, "checking the script; nothing has moved yet",
        )  # fmt: skip
        assert (found["readings"]["run"], found["readings"]["columns"], found["readings"]["rows"]) == (None, [], [])
        assert watcher.outlet.source is NOTHING
        assert watcher.job == watcher.bench.job


def test_where_nobody_announces_a_run_the_one_that_grows_is_followed(make: Make) -> None:
    panel = make()
    watcher, now_s = panel.watcher, panel.clock.unix_s()
    run = journal(watcher.out / "20260101-run", START, sample(1.5))
    os.utime(run / "events.jsonl", (now_s, now_s))
    with watcher.outlet.joined() as client:
        state = told(watcher, client)["state"]
        assert (state["run"]["name"], state["run"]["state"]) == ("20260101-run", "running")
        panel.clock.wait_s(10.0)
        assert told(watcher, client)["state"]["run"]["state"] == "killed"
        other = journal(watcher.out / "20260102-other", START)
        os.utime(other / "events.jsonl", (now_s + 10.0, now_s + 10.0))
        panel.clock.wait_s(1.0)
        assert told(watcher, client)["state"]["run"]["name"] == "20260102-other"


def test_how_often_is_looked() -> None:
    """A page has a reading within a tenth of a second, and a state at least twice a second."""
    assert (LOOK_S, ASK_S, FIND_S, BEAT_S, STATUS_S) == (0.05, 0.1, 1.0, 0.4, 0.5)


def test_what_is_drawn_is_of_the_run_that_is_followed(make: Make, tmp_path: Path) -> None:
    mount = {"doc": "event", "stream": "mount", "data": {"indentor": "bar:3.0"}}
    run = journal(tmp_path / "run", START, mount)
    owner = StubOwner(run=str(run), answers={"status": {"ok": True, "state": "running"}})
    watcher = make(owner).watcher
    assert watcher.job == watcher.bench.job
    look(watcher)
    assert watcher.run is not None
    assert watcher.job is watcher.run.job is not None
    assert (owner.asked, owner.within_s) == ([("status", {})], [STATUS_S])
    assert watcher.bench.devices_state(0.0)["stage"]["word"] == "no data"


def test_an_announced_run_goes_on_however_silent_it_is(make: Make, tmp_path: Path) -> None:
    run = journal(tmp_path / "run", START)
    os.utime(run / "events.jsonl", (10.0, 10.0))
    panel = make(StubOwner(run=str(run), answers={"status": {"ok": True, "state": "paused"}}))
    with panel.watcher.outlet.joined() as client:
        state = told(panel.watcher, client)["state"]
        assert (state["run"]["state"], state["notice"]) == ("running", "paused after a lift")
        panel.owners.clear()
        state = told(panel.watcher, client)["state"]
        assert (state["run"]["state"], state["notice"]) == ("killed", None)


def test_of_a_run_that_ended_nothing_is_now(make: Make, tmp_path: Path) -> None:
    """Its owner may be at its report still."""
    run = journal(tmp_path / "run", START)
    Course(9.0, {("home", 1, 0): 5.0}, {("home", 1, 0): "home"}).save(RunFolder(run))
    watcher = make(StubOwner(run=str(run), answers={"status": {"ok": True, "state": "reporting"}})).watcher
    with watcher.outlet.joined() as client:
        assert told(watcher, client)["state"]["run"]["now"] == "home"
        journal(run, {"doc": "stop", "status": "aborted", "reason": "by the operator"})
        state = told(watcher, client)["state"]
        assert (state["run"]["now"], state["run"]["left_s"], state["run"]["ending"]) == (
            None,
            None,
            "by the operator",
        )
        assert state["notice"] == "making the report"


def test_an_owner_is_told_of_together_with_what_it_says(make: Make) -> None:
    """Not as one that cannot be reached, before it was asked."""
    panel = make(StubOwner())
    panel.watcher.owners = ()
    seen: list[object] = []
    panel.owners[0].answers["status"] = lambda: seen.append(panel.watcher.owner) or {"ok": True, "state": "running"}
    look(panel.watcher)
    assert seen == [None]
    assert panel.watcher.owner is panel.owners[0]


def test_runs_are_not_searched_for_all_the_time(make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    panel, searched = make(), list[float]()
    monkeypatch.setattr("rig.panel.watcher.growing", lambda out, unix_s: searched.append(unix_s))
    for _ in range(4):
        look(panel.watcher)
    assert len(searched) == 1
    panel.clock.wait_s(1.0)
    look(panel.watcher)
    assert len(searched) == 2


def test_the_bench_by_hand(make: Make, tmp_path: Path) -> None:
    row = [5.0, 5.0, 0.25, 1.0, 2.0, 3.0, None]
    status = {
        "ok": True, "state": "idle", "stopped": False, "force_gwt": 0.25, "read_unix_s": 999.0, "homed": True,
        "readings": {"columns": list(HAND.columns), "rows": [row], "next": 4},
    }  # fmt: skip
    hand = StubOwner(kind="by hand", answers={"status": status})
    panel = make(hand)
    watcher = panel.watcher
    with watcher.outlet.joined() as client:
        found = told(watcher, client)
        assert hand.asked == [("status", {"since": 0})]
        assert found["readings"]["hand"] is True
        assert found["readings"]["rows"] == [row]
        state = found["state"]
        assert state["hand"] == {name: value for name, value in status.items() if name != "readings"}
        assert (state["run"], state["newest"]["age_s"], state["devices"]["stage"]["word"]) == (None, 1.0, "idle")
        assert state["limits"]["margin_gwt"] == state["limits"]["trip_gwt"] - 0.25
        look(watcher)
        assert hand.asked[-1] == ("status", {"since": 4})
        panel.owners[:] = [StubOwner(pid=9, kind="by hand", answers={"status": ControlError("gone")})]
        found = told(watcher, client)
        assert panel.owners[0].asked == [("status", {"since": 0})]
        assert (found["readings"]["reset"], found["state"]["owner"]["reachable"]) == (True, False)
        assert (found["state"]["hand"], found["state"]["newest"]["force_gwt"]) == (None, None)
        run = journal(tmp_path / "run", START)
        panel.owners[:] = [StubOwner(run=str(run), answers={"status": {"ok": True, "state": "running"}})]
        assert told(watcher, client)["readings"]["hand"] is False
        Course(9.0, {("home", 1, 0): 5.0}, {("home", 1, 0): "home"}).save(RunFolder(run))
        assert len(told(watcher, client)["schedule"]["steps"]) == 1
        panel.owners[:] = [StubOwner(pid=9, kind="by hand", answers={"status": status})]
        found = told(watcher, client)
        assert (found["readings"]["hand"], found["schedule"]["steps"]) == (True, [])
        assert found["schedule"]["run"] is None


def test_a_state_is_told_when_it_changes_and_otherwise_now_and_then(make: Make) -> None:
    panel = make()
    watcher = panel.watcher
    with watcher.outlet.joined() as client:
        assert told(watcher, client)["state"]["unix_s"] == 1000.0
        panel.clock.wait_s(BEAT_S - 0.01)
        assert "state" not in told(watcher, client)
        panel.clock.wait_s(0.01)
        assert told(watcher, client)["state"]["unix_s"] == pytest.approx(1000.0 + BEAT_S)
        watcher.tabs.take("a", panel.clock.monotonic_s())
        assert told(watcher, client)["state"]["controls"] == "a"
        assert "state" not in told(watcher, client)
        panel.owners.append(StubOwner(answers={"status": ControlError("hangs")}))
        assert told(watcher, client)["state"]["owner"]["reachable"] is False
        panel.owners[0].answers["status"] = {"ok": True, "state": "paused", "stopped": True}
        state = told(watcher, client)["state"]
        assert (state["owner"]["stopped"], state["notice"]) == (True, "paused after a lift")
        watcher.find = _not_ours
        state = told(watcher, client)["state"]
        assert (state["owner"], state["problem"]) == (None, "/run/rig: not yours")
    assert BEAT_S < 0.5


def test_a_process_by_hand_that_ended_by_itself_is_told_of(make: Make) -> None:
    watcher = make().watcher
    with watcher.outlet.joined() as client:
        assert told(watcher, client)["state"]["notice"] is None
        watcher.last_line = lambda: "/dev/ttyUSB0: gone"
        assert told(watcher, client)["state"]["notice"] == "/dev/ttyUSB0: gone"


def _not_ours() -> list[StubOwner]:
    raise PermissionError(1, "not yours", "/run/rig")


def test_the_time_left_alone_is_no_change(make: Make, tmp_path: Path) -> None:
    run = journal(tmp_path / "run", START)
    Course(100.0, {("home", 1, 0): 50.0}, {("home", 1, 0): "home"}).save(RunFolder(run))
    owner = StubOwner(run=str(run), answers={"status": {"ok": True, "state": "running"}})
    watcher = make(owner).watcher
    with watcher.outlet.joined() as client:
        found = told(watcher, client)
        assert found["state"]["run"]["left_s"] == 100.0
        assert [one["words"] for one in found["schedule"]["steps"]] == ["home"]
        assert found["schedule"]["run"] == "run"
        journal(run, {"doc": "event", "stream": "note", "data": {"text": "a"}, "t_s": 10.0})
        assert told(watcher, client) == {}
        journal(run, {"doc": "event", "stream": "home", "data": {"controller": "a"}, "t_s": 20.0})
        found = told(watcher, client)
        assert found["schedule"]["steps"][0]["done"] is True


def test_it_looks_on_until_it_is_cancelled(make: Make, tmp_path: Path) -> None:
    run = journal(tmp_path / "run", START, sample(1.0))
    watcher = make(StubOwner(run=str(run), answers={"status": {"ok": True, "state": "running"}})).watcher

    async def looks_on() -> None:
        with watcher.outlet.joined() as client:
            task = asyncio.create_task(watcher.follow())
            seen: dict[str, Any] = {}
            while not seen.get("state", {}).get("run") or "readings" not in seen:
                await client.woken.wait()
                seen |= dict(events(client.taken(0.0)))
            task.cancel()
            with pytest.raises(asyncio.CancelledError):
                await task

    asyncio.run(looks_on())
    assert isinstance(watcher.clock, VirtualClock)


def test_what_was_read_of_a_run_that_is_followed_no_more_is_told_to_nobody(
    make: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Somebody took the bench by hand while its journal was looked at."""
    run = journal(tmp_path / "run", START)
    watcher = make(StubOwner(run=str(run), answers={"status": {"ok": True, "state": "running"}})).watcher

    def left(seen: RunView, unix_s: float) -> list[list[float]]:
        watcher.run = None
        return [[0.0] * 9]

    monkeypatch.setattr(RunView, "look", left)
    with watcher.outlet.joined() as client:
        found = told(watcher, client)
    assert (found["readings"]["rows"], found["state"]["run"]) == ([], None)


def test_a_run_that_is_followed_no_more_leaves_no_schedule(make: Make, tmp_path: Path) -> None:
    run = journal(tmp_path / "run", START)
    Course(9.0, {("home", 1, 0): 5.0}, {("home", 1, 0): "home"}).save(RunFolder(run))
    panel = make(StubOwner(run=str(run), answers={"status": {"ok": True, "state": "running"}}))
    with panel.watcher.outlet.joined() as client:
        assert len(told(panel.watcher, client)["schedule"]["steps"]) == 1
        panel.owners[0].run = None
        found = told(panel.watcher, client)["schedule"]
        assert (found["steps"], found["run"]) == ([], None)


def test_controls_of_a_tab_that_has_left_are_free(make: Make) -> None:
    panel = make()
    with panel.watcher.outlet.joined() as client:
        panel.watcher.tabs.take("a", panel.clock.monotonic_s())
        assert told(panel.watcher, client)["state"]["controls"] == "a"
        panel.clock.wait_s(5.1)
        assert told(panel.watcher, client)["state"]["controls"] is None


@pytest.mark.parametrize(
    ("pids", "shown", "others"),
    [
        ({1: ("/dev/ttyUSB0", "/dev/ttyUSB9")}, 1, []),
        ({1: ("/dev/ttyUSB0",), 2: ("/dev/ttyACM7",)}, 1, [2]),
        ({2: ("/dev/ttyACM7", "tcp://127.0.0.1:9")}, None, [2]),
        ({2: ("/dev/ttyACM7",), 3: ()}, 3, [2]),
    ],
    ids=["its own rig", "another rig began later", "another rig alone", "a dry run beside another rig"],
)
def test_a_panel_shows_and_asks_only_the_rig_of_its_configuration(
    make: Callable[..., StubPanel], pids: dict[int, tuple[str, ...]], shown: int | None, others: list[int]
) -> None:
    owners = [
        StubOwner(pid=pid, ports=ports, virtual=not ports, began_unix_s=float(pid)) for pid, ports in pids.items()
    ]
    watcher = make(*owners).watcher
    state = watcher.state(0.0)
    assert (None if state["owner"] is None else state["owner"]["pid"]) == shown
    assert [one["pid"] for one in state["others"]] == others
    assert list(watcher.owners) == owners, "STOP reaches all"


def test_a_panel_without_configuration_shows_the_newest_rig(make: Callable[..., StubPanel]) -> None:
    older, newer = StubOwner(pid=1, ports=("a",)), StubOwner(pid=2, ports=("b",), began_unix_s=9.0)
    assert make(older, newer, configured=False).watcher.owner is newer
