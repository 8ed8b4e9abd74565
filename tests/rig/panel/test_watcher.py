"""What is looked at: the owner that is shown, the run that goes on, and what pages are told of both."""

import asyncio
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rig.control.client import ControlError
from rig.panel.stream import NOTHING, PageQueue
from rig.panel.watcher import Watcher
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
        await watcher.publish()

    asyncio.run(once())


def told(watcher: Watcher, client: PageQueue) -> dict[str, Any]:
    look(watcher)
    return dict(events(client.taken(0.0)))


def test_the_state_of_the_participants_button_is_shown(make: Make, tmp_path: Path) -> None:
    run = journal(tmp_path / "run", START)
    status = {"ok": True, "state": "running", "stopped": False, "stop_button": "not pressed, tested"}
    watcher = make(StubOwner(run=str(run), answers={"status": status})).watcher
    with watcher.outlet.joined() as client:
        assert told(watcher, client)["state"]["owner"]["stop_button"] == "not pressed, tested"


def test_the_run_of_an_owner_is_shown_wherever_its_folder_is(make: Make, tmp_path: Path) -> None:
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


def test_an_ended_run_is_shown_until_another_one_is_planned(make: Make, tmp_path: Path) -> None:
    run = journal(tmp_path / "run", START, sample(1.5))
    owner = StubOwner(run=str(run), answers={"status": {"ok": True, "state": "running"}})
    panel = make(owner)
    watcher = panel.watcher
    look(watcher)
    journal(run, {"doc": "stop", "status": "aborted"})
    panel.owners.clear()
    with watcher.outlet.joined() as client:
        state = told(watcher, client)["state"]
        assert (state["owner"], state["run"]["state"], state["run"]["now"]) == (None, "aborted", None)
        assert state["attention"]["status"] == "aborted"
        panel.owners.append(StubOwner(pid=2, answers={"status": {"ok": True, "state": "planning"}}))
        found = told(watcher, client)
        assert (found["state"]["run"], found["state"]["attention"], found["state"]["notice"]) == (
            None, None, "checking the script; nothing has moved yet",
        )  # fmt: skip
        assert (found["readings"]["run"], found["readings"]["columns"], found["readings"]["rows"]) == (None, [], [])
        assert watcher.outlet.source is NOTHING
        assert watcher.job == watcher.bench.job


def test_without_an_owner_the_run_whose_journal_grows_is_shown(make: Make) -> None:
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


def test_an_announced_run_counts_as_running_however_silent_it_is(make: Make, tmp_path: Path) -> None:
    run = journal(tmp_path / "run", START)
    os.utime(run / "events.jsonl", (10.0, 10.0))
    panel = make(StubOwner(run=str(run), answers={"status": {"ok": True, "state": "paused"}}))
    with panel.watcher.outlet.joined() as client:
        state = told(panel.watcher, client)["state"]
        assert (state["run"]["state"], state["notice"]) == ("running", "paused after a lift")
        panel.owners.clear()
        state = told(panel.watcher, client)["state"]
        assert (state["run"]["state"], state["notice"]) == ("killed", None)


def test_the_page_names_a_stop_and_an_owner_that_does_not_answer(make: Make) -> None:
    panel = make()
    watcher = panel.watcher
    with watcher.outlet.joined() as client:
        assert told(watcher, client)["state"]["unix_s"] == 1000.0
        panel.owners.append(StubOwner(answers={"status": ControlError("hangs")}))
        assert told(watcher, client)["state"]["owner"]["reachable"] is False
        panel.owners[0].answers["status"] = {"ok": True, "state": "paused", "stopped": True}
        state = told(watcher, client)["state"]
        assert (state["owner"]["stopped"], state["notice"]) == (True, "paused after a lift")
        assert state["attention"]["may_touch"] is True
        watcher.find = _not_ours
        state = told(watcher, client)["state"]
        assert (state["owner"], state["problem"]) == (None, "/run/rig: not yours")


def test_the_reason_why_manual_control_ended_by_itself_is_shown(make: Make) -> None:
    watcher = make().watcher
    with watcher.outlet.joined() as client:
        assert told(watcher, client)["state"]["notice"] is None
        watcher.last_line = lambda: "/dev/ttyUSB0: gone"
        assert told(watcher, client)["state"]["notice"] == "/dev/ttyUSB0: gone"


def _not_ours() -> list[StubOwner]:
    raise PermissionError(1, "not yours", "/run/rig")


def test_a_tab_that_has_left_gives_control_back(make: Make) -> None:
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


@pytest.mark.parametrize("announced", [True, False], ids=["announced", "found by its journal"])
def test_a_dry_run_does_not_replace_the_notice_of_the_rig(
    make: Callable[..., StubPanel], tmp_path: Path, announced: bool
) -> None:
    at = {"left": "held", "x_mm": 0.5, "height_mm": -0.1, "trusted": False, "may_touch": True, "contact": "touching"}
    stop = {"doc": "stop", "status": "aborted", "reason": "stopped at once", "indentor": at}
    run = journal(tmp_path / "real", {**START, "virtual": False}, sample(1.5), stop)
    real = StubOwner(run=str(run), answers={"status": {"ok": True, "state": "running", "stopped": True}})
    watcher = make(real).watcher
    look(watcher)
    notice = watcher.state(0.0)["attention"]
    assert notice["may_touch"] is True
    dry = journal(watcher.out / "dry", START, sample(0.5))
    owner = StubOwner(pid=2, ports=(), virtual=True, run=str(dry), began_unix_s=9.0)
    watcher.find = lambda: [owner] if announced else []
    look(watcher)
    state = watcher.state(0.0)
    assert (state["attention"], state["run"]["name"], state["owner"], state["others"]) == (notice, "real", None, [])
    newer = journal(tmp_path / "newer", {**START, "virtual": False})
    watcher.find = lambda: [owner, StubOwner(pid=3, run=str(newer))]
    look(watcher)
    state = watcher.state(0.0)
    assert (state["attention"], state["run"]["name"]) == (None, "newer")
