"""Nothing that looks on for hours keeps more than what it shows: neither of what comes, nor of what is asked."""

import asyncio
import itertools
import json
from collections.abc import Callable
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from rig.cli.watch import RunScreen
from rig.control.client import ControlError
from rig.data.folder import RunFolder
from rig.data.run import Following
from rig.data.run_state import Course
from rig.manual.status import Backlog
from rig.panel.run_view import RunView, growing
from rig.panel.section import Job, PressSummary, Sections
from rig.panel.stream import Outlet
from rig.panel.watcher import HAND, BenchView
from rig.plan.config import Config
from sim.devices.clock import VirtualClock
from tests.memory_use import Step, kept_bytes, needed_bytes
from tests.rig.panel.stub_panel import StubOwner, StubPanel

Make = Callable[..., StubPanel]

READINGS, PRESS_S, ROWS = 20, 12.0, 60
MOST_KEPT = 50_000
"""Bytes, after fifty more steps of the same; the events of a press that are kept have 6600 each time."""
MOST_NEEDED = 100_000
"""Bytes that a look needs where nothing is new: some files are opened, and a state is written."""


class Forgetful(StubOwner):
    """Notes nothing of what it was asked."""

    def ask(self, do: str, *, within_s: float = 1.0, **more: Any) -> dict[str, Any]:
        try:
            return super().ask(do, within_s=within_s, **more)
        finally:
            self.asked.clear()
            self.within_s.clear()


class Run:
    """A journal that grows by a press at a time, with all its readings and events; index and time go on."""

    def __init__(self, path: Path) -> None:
        self.folder, self.n = RunFolder(path), 0
        path.mkdir(parents=True)
        (path / "config.toml").write_text(Config().as_toml(), encoding="utf-8")
        self._write({"doc": "start", "t_s": 0.0, "unix_s": 0.0, "planned_indentations": 9, "virtual": False})
        name = ("indentation_start", 0, 0)
        Course(9.0, {name: 0.0}, {name: "press"}).save(self.folder)

    def press(self) -> list[dict[str, Any]]:
        """One more; returns its documents."""
        t_s = PRESS_S * self.n
        index = self.n % 9  # a plan has an end, and what is done of it is known
        about = {"index": index, "indentor": "bar:3.0", "x_mm": 0.1, "block": 1, "repeat": 2, "condition": "bar:3.0"}
        events = [("indentation_start", about | {"target": "doi_mm", "value": 1.0}), ("touch", about)]
        reading = {"index": index, "phase": "press", "x_mm": 0.1, "height_mm": 0.1, "doi_mm": 0.1, "force_gwt": 1.5}
        events += [("sample", reading)] * READINGS
        events += [("hold_end", about | {"hold": 0}), ("indentation_end", about), ("note", {"text": f"at {t_s}"})]
        self.n += 1
        found = [self._event(t_s + n * PRESS_S / len(events), *event) for n, event in enumerate(events)]
        self._write(*found)
        return found

    def _event(self, t_s: float, stream: str, data: dict[str, Any]) -> dict[str, Any]:
        return {"doc": "event", "stream": stream, "t_s": t_s, "unix_s": t_s, "data": data}

    def _write(self, *documents: dict[str, Any]) -> None:
        with self.folder.events.open("a", encoding="utf-8") as file:
            file.writelines(json.dumps(one) + "\n" for one in documents)


def a_run_that_two_pages_see(tmp_path: Path, make: Make, there: ExitStack) -> Step:
    """All that the panel's watcher does, with a page that does not fetch and one that does."""
    run = Run(tmp_path / "run")
    watcher = make(Forgetful(run=str(run.folder.path), answers={"status": {"ok": True, "state": "running"}})).watcher
    loop = there.enter_context(closing(asyncio.new_event_loop()))
    slow, quick = (there.enter_context(watcher.outlet.joined()) for _ in range(2))

    async def look() -> None:
        await watcher.ask()
        await watcher.read()
        await watcher.publish()

    def step() -> None:
        run.press()
        loop.run_until_complete(look())
        assert quick.taken(0.0).count('"data"]') == READINGS
        assert len(slow.rows) <= ROWS

    return step


def a_bench_that_a_page_sees(tmp_path: Path, make: Make, there: ExitStack) -> Step:
    rows = [[0.0] * len(HAND.columns)] * READINGS
    new = {"columns": list(HAND.columns), "rows": rows, "next": 4}
    status = {"ok": True, "state": "Idle", "force_gwt": 1.0, "readings": new}
    loop = there.enter_context(closing(asyncio.new_event_loop()))
    watcher = make(Forgetful(kind="by hand", answers={"status": status})).watcher
    page = there.enter_context(watcher.outlet.joined())

    async def look() -> None:
        await watcher.ask()
        await watcher.publish()

    def step() -> None:
        loop.run_until_complete(look())
        assert READINGS <= len(page.rows) <= ROWS

    return step


def a_run_in_a_terminal(tmp_path: Path, make: Make, there: ExitStack) -> Step:
    run = Run(tmp_path / "run")
    seen, journal = RunScreen(run.folder), Following(run.folder)

    def step() -> None:
        run.press()
        seen.take(journal.new())
        assert seen.newest["force_gwt"] == 1.5
        assert seen.steps

    return step


def requests_of_a_page(tmp_path: Path, make: Make, there: ExitStack) -> Step:
    """Answered, or refused."""

    def refused() -> dict[str, Any]:
        raise ControlError("no")

    panel = make(Forgetful(), Forgetful(pid=2, kind="by hand", answers={"home": refused}, began_unix_s=1.0))

    def step() -> None:
        click = {"axis": "x", "sign": 1, "by_mm": 0.5, "unix_s": 1000.0}
        codes = [panel.post(f"/{path}", click)[0] for path in ("take", "stop", "step", "park", "home", "pause")]
        assert codes == [200, 200, 200, 200, 503, 409]

    return step


def questions_to_the_bench_by_hand(tmp_path: Path, make: Make, there: ExitStack) -> Step:
    backlog, told = Backlog(), itertools.count(0, 500)

    def step() -> None:
        since = next(told)
        for n in range(500):
            backlog.add((float(n), *[0.0] * 6))
        assert backlog.since(since)["rows"][0][0] == 0.0

    return step


def drawings(tmp_path: Path, make: Make, there: ExitStack) -> Step:
    loop = there.enter_context(closing(asyncio.new_event_loop()))
    presses, wanted = itertools.count(), [Job(tmp_path / "rig.toml", indentor="bar:3.0")]
    sections = Sections(lambda: wanted[0], Outlet(), VirtualClock())

    def step() -> None:
        wanted[0] = replace(wanted[0], press=PressSummary(next(presses), "data", 0.1, "doi_mm", 1.0))
        loop.run_until_complete(sections.look())

    return step


LOOKING_ON = [
    a_run_that_two_pages_see,
    a_bench_that_a_page_sees,
    a_run_in_a_terminal,
    requests_of_a_page,
    questions_to_the_bench_by_hand,
    drawings,
]


@pytest.mark.quick(rows=lambda looking_on: looking_on is not a_run_that_two_pages_see)
@pytest.mark.parametrize("looking_on", LOOKING_ON, ids=lambda one: one.__name__.replace("_", " "))
def test_monitoring_for_hours_needs_no_more_memory(
    looking_on: Callable[[Path, Make, ExitStack], Step],
    tmp_path: Path,
    make: Make,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("rig.panel.stream.MOST_ROWS", ROWS)  # full at once; as many as there are: test_outlet.py
    monkeypatch.setattr("rig.data.run_state.LATE", 50)
    with ExitStack() as there:
        step = looking_on(tmp_path, make, there)
        assert kept_bytes(step, first=20, then=50) < MOST_KEPT


@pytest.mark.parametrize("what", ["a run", "no run", "runs", "a journal", "a bench"])
def test_a_poll_without_news_allocates_next_to_nothing(what: str, tmp_path: Path, make: Make) -> None:
    """Twenty times a second: a buffer of a megabyte, cut to what came, left the heap of its thread full of holes."""
    run = Run(tmp_path / "runs" / "run")
    for _ in range(5):
        run.press()
    seen, journal, bench = RunView(run.folder.path), Following(run.folder), BenchView(tmp_path / "c", Config())
    watcher = make().watcher

    async def look() -> None:
        await watcher.ask()
        await watcher.read()
        await watcher.publish()

    looks: dict[str, Step] = {
        "a run": lambda: seen.look(0.0),
        "no run": lambda: asyncio.run(look()),
        "runs": lambda: growing(tmp_path / "runs", 0.0),
        "a journal": lambda: journal.next(1 << 20),
        "a bench": lambda: (bench.update({"state": "Idle"}), bench.devices_state(0.0), bench.newest_state(0.0)),
    }
    assert needed_bytes(looks[what]) < MOST_NEEDED
