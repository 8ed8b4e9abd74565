"""State of the rig for pages: the owners of ports, and the run in progress."""

import asyncio
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from rig.clock import Clock
from rig.control.client import ControlError
from rig.devices.registry import stage_ports
from rig.engine.bench_memory import BenchMemory, LastKnown
from rig.panel.notice import Notice, manual_notice, standing_notice, stopped_now
from rig.panel.owners import Find, Owner, Tabs, owner_state, run_of, shown
from rig.panel.run_view import RunView, age_s, growing, last_real_run, limits_state
from rig.panel.section import Job
from rig.panel.stream import NOTHING, Outlet, ReadingSource, Row
from rig.plan.config import Config
from rig.settings import BenchSettings

COLUMNS = ("unix_s", "t_s", "force_gwt", "x_mm", "y_mm", "z_mm", "height_mm")
HAND = ReadingSource(None, COLUMNS, hand=True)


def ports_of(settings: BenchSettings) -> tuple[str, ...]:
    """Return the ports of the stage and of the force sensor."""
    return (*stage_ports(settings.stage), settings.force.port)


class BenchView:
    """Last state of manual control; empty if no process provides it."""

    def __init__(self, path: Path | None = None, config: Config | None = None) -> None:
        self.path, self._config = path, config
        self._status: Mapping[str, Any] = {}
        self.owner: int | None = None
        self.since = 0  # first reading that is not yet sent

    def begin(self, owner: int) -> None:
        """Follow another process of manual control."""
        self.owner, self.since, self._status = owner, 0, {}

    def since_of(self, owner: int) -> int:
        """Return the number from which readings of a process are new."""
        return self.since if owner == self.owner else 0

    @property
    def configured(self) -> bool:
        """Whether a configuration allows manual control."""
        return self._config is not None

    @property
    def settings(self) -> BenchSettings | None:
        """Settings of the devices; None without a configuration."""
        return self._config

    @property
    def ports(self) -> tuple[str, ...]:
        """Ports of the devices."""
        return () if self._config is None else ports_of(self._config)

    @property
    def job(self) -> Job | None:
        """Drawing of the finger alone, since the mounted indentor is unknown."""
        return None if self.path is None else Job(self.path)

    def update(self, status: Mapping[str, Any] | None) -> list[Row]:
        """Store the reply of the owner, None without one, and return its new readings."""
        if status is None:
            return []
        self._status = status
        new = status.get("readings")
        if new is None:
            return []
        self.since = new["next"]
        rows = (dict(zip(new["columns"], row, strict=True)) for row in new["rows"])
        return [[{**row, **self._on_the_finger(row)}[name] for name in COLUMNS] for row in rows]

    def _on_the_finger(self, at: Mapping[str, Any]) -> dict[str, Any]:
        """Return x and y from the center of the pad of a position of the machine; None without its height."""
        if self._config is None or at.get("height_mm") is None:
            return {"x_mm": None, "y_mm": None}
        frame = self._config.frame
        zeros = {"x_mm": frame.pad_centre_x_mm, "y_mm": frame.pad_y_mm}
        return {name: round(at[name] - zero_mm, 6) for name, zero_mm in zeros.items()}

    def newest_state(self, unix_s: float) -> dict[str, Any]:
        """Return `newest` of the state."""
        status = self._status
        return {
            **{name: status.get(name) for name in ("force_gwt", "height_mm")},
            **self._on_the_finger(status),
            "doi_mm": None,
            "phase": status.get("busy"),
            "t_s": status.get("read_t_s"),
            "age_s": age_s(status.get("read_unix_s"), unix_s),
            "placed_age_s": age_s(status.get("seen_unix_s"), unix_s),
        }

    @property
    def attention(self) -> Notice | None:
        """Return `attention` of the state after a stop or a trip, until the stage is homed."""
        return manual_notice(self._status)

    def devices_state(self, unix_s: float) -> dict[str, Any]:
        """Return `devices` of the state."""
        status = self._status
        force = "no data" if status.get("force_gwt") is None else "zeroed" if status.get("zeroed") else "reads"
        return {
            "stage": {
                "word": status.get("stage_problem") or status.get("state", "no data"),
                "homed": bool(status.get("homed")),
                "age_s": age_s(status.get("seen_unix_s"), unix_s),
            },
            "force": {
                "word": status.get("force_problem") or force,
                "age_s": age_s(status.get("read_unix_s"), unix_s),
            },
        }

    def limits_state(self) -> dict[str, Any] | None:
        """Return `limits` of the state."""
        return None if self._config is None else limits_state(self._config, None)


LOOK_S, ASK_S, FIND_S = 0.05, 0.1, 1.0
"""Periods (s): journal poll, owner poll and publication of the state, search for runs."""
STATUS_S = 0.5
"""Longest wait for a request for the state (s)."""
_NOTICES = {
    "planning": "checking the script; nothing has moved yet",
    "asking": "waiting for an answer at its terminal",
    "pausing": "pausing; lifting at the next safe point",
    "paused": "paused after a lift",
    "reporting": "making the report",
}


@dataclass
class Watcher:
    """State of the rig; its loops run until they are cancelled."""

    out: Path
    bench: BenchView
    find: Find
    clock: Clock
    outlet: Outlet = field(default_factory=Outlet)
    tabs: Tabs = field(default_factory=Tabs)
    owners: Sequence[Owner] = ()
    run: RunView | None = None
    problem: str = ""
    last_line: Callable[[], str] = str  # of an ended process of manual control

    def __post_init__(self) -> None:
        self._asking, self._reading = ThreadPoolExecutor(2, "asking"), ThreadPoolExecutor(1, "reading")
        self._status: dict[str, Any] | None = None
        self._run_state: dict[str, Any] | None = None
        self._attention: Notice | None = None  # of the run, or of what is on disk
        self._attended: tuple[object, float] = (None, -FIND_S)  # what it was found for, and when
        self._looked_back = False  # whether the last run was searched since the rig had an owner
        self._schedule: list[dict[str, Any]] = []
        self._found: tuple[Path | None, float] = (None, -FIND_S)

    @property
    def owner(self) -> Owner | None:
        """Owner that the pages show: of the panel's own devices if it has a configuration, or a virtual one."""
        return shown(self._of_this_rig(self.owners))

    @property
    def others(self) -> list[Owner]:
        """Owners of other devices, which get nothing from this panel but STOP."""
        mine = self._of_this_rig(self.owners)
        return [one for one in self.owners if one not in mine and not one.virtual]

    def _of_this_rig(self, owners: Sequence[Owner]) -> list[Owner]:
        own = set(map(_device, self.bench.ports))
        real = [one for one in owners if not one.virtual and (not own or own & set(map(_device, one.ports)))]
        return real if self._noticed else [*real, *(one for one in owners if one.virtual)]

    @property
    def _noticed(self) -> bool:
        """Whether a notice of the rig stands, which only its next owner replaces, and no dry run."""
        return self._attention is not None and (self.run is None or not self.run.virtual)

    @property
    def job(self) -> Job | None:
        """Job of the drawing."""
        if self.run is not None:
            return self.run.job
        return self.bench.job

    async def follow(self) -> None:
        """Poll until cancelled."""
        async with asyncio.TaskGroup() as loops:
            for each_s, look in ((ASK_S, self.ask), (LOOK_S, self.read), (ASK_S, self.publish)):
                loops.create_task(_again(each_s, look))

    # --- polling ---

    async def ask(self) -> None:
        """Poll the owners, and the state of the shown one."""
        loop, status = asyncio.get_running_loop(), None
        try:
            owners, problem = await loop.run_in_executor(self._asking, self.find), ""
        except OSError as error:
            owners, problem = (), f"{error.filename}: {error.strerror}"
        owner = shown(self._of_this_rig(owners))
        if owner is not None:
            status = await loop.run_in_executor(self._asking, _status_of, owner, self.bench.since_of(owner.pid))
        self.owners, self.problem, self._status = owners, problem, status
        if owner is not None and owner.kind == "by hand":
            self._show_manual(owner)
            self.outlet.add(self.bench.update(status))

    def _show_manual(self, owner: Owner) -> None:
        """Show readings of manual control from now on."""
        if self.outlet.source != HAND or self.bench.owner != owner.pid:
            self.run, self._run_state, self._attention = None, None, None
            self.bench.begin(owner.pid)
            self.outlet.begin(HAND)
            self._publish_schedule([])

    async def read(self) -> None:
        """Read new entries of the journal of the running protocol, and find the notice."""
        loop, owner = asyncio.get_running_loop(), self.owner
        if owner is not None and not owner.virtual:
            self._looked_back = False
        elif self.run is None and not self._looked_back:
            self._looked_back = True
            run, attention = await loop.run_in_executor(self._reading, self._last_on_the_rig)
            self._follow(run)
            self._attention, owner = attention, self.owner if attention is None else None
        folder = await self._folder(owner)
        if folder is None:
            if owner is not None:
                self._follow(None)
        elif (self.run is None or self.run.folder.path != folder) and (owner is not None or not self._noticed):
            self._follow(RunView(folder))
        if (run := self.run) is not None:
            look = partial(run.look, self.clock.unix_s(), announced=owner is not None)
            rows = await loop.run_in_executor(self._reading, look)
            if run is not self.run:
                return
            self.outlet.add(rows)
            going = not run.ended and (run.alive or owner is not None)
            self._run_state = run.as_json(going=going)
            self._publish_schedule(run.schedule_state())
            if going or owner is not None or run.virtual:
                self._attention = run.attention(going=going, stopped=bool((self._status or {}).get("stopped")))
                return
        if owner is None:
            await self._find_standing_notice(run)

    async def _find_standing_notice(self, run: RunView | None) -> None:
        """Find the notice on disk, at once after a run or an owner, and then from time to time."""
        what, now_s = (run, run is not None and run.ended), self.clock.monotonic_s()
        if self._attended[0] != what or now_s - self._attended[1] >= FIND_S:
            loop = asyncio.get_running_loop()
            found = await loop.run_in_executor(self._reading, self._standing_notice, run)
            if run is self.run:
                self._attention, self._attended = found, (what, now_s)

    def _standing_notice(self, run: RunView | None) -> Notice | None:
        settings = self.bench.settings or (None if run is None else run.config)
        return standing_notice(run, LastKnown() if settings is None else BenchMemory(settings).read())

    def _last_on_the_rig(self) -> tuple[RunView | None, Notice | None]:
        """Return the last run on the rig if its notice stands, and the notice."""
        own = set(map(_device, self.bench.ports))
        run = last_real_run(self.out, lambda config: not own or bool(own & set(map(_device, ports_of(config)))))
        without = self._standing_notice(None)
        if run is None:
            return None, without
        run.look(self.clock.unix_s())
        found = run.attention(going=True, stopped=False) if run.alive else self._standing_notice(run)
        return (RunView(run.folder.path), found) if run.alive or found != without else (None, without)

    async def _folder(self, owner: Owner | None) -> Path | None:
        """Return the folder of the followed run."""
        if owner is not None:
            return run_of(owner)
        found, then_s = self._found
        now_s = self.clock.monotonic_s()
        if now_s - then_s >= FIND_S:
            loop = asyncio.get_running_loop()
            found = await loop.run_in_executor(self._reading, growing, self.out, self.clock.unix_s())
            self._found = found, now_s
        return found

    def _follow(self, run: RunView | None) -> None:
        if run is None and self.run is None:
            return
        self.run, self._run_state, self._attention = run, None, None
        self.outlet.begin(NOTHING if run is None else run.source)
        self._publish_schedule([])

    # --- publishing ---

    def _publish_schedule(self, steps: list[dict[str, Any]]) -> None:
        if steps != self._schedule:
            self._schedule = steps
            run = None if self.run is None else self.run.name
            self.outlet.publish("schedule", {"unix_s": self.clock.unix_s(), "run": run, "steps": steps})

    async def publish(self) -> None:
        """Publish the state."""
        self.tabs.look(self.clock.monotonic_s())
        self.outlet.publish("state", self.state(self.clock.unix_s()))

    def state(self, unix_s: float) -> dict[str, Any]:
        """Return the state, except readings and drawings."""
        owner, status = self.owner, self._status
        by_hand = status is not None and owner is not None and owner.kind == "by hand"
        hand = {name: value for name, value in status.items() if name != "readings"} if status and by_hand else None
        seen: RunView | BenchView = self.bench if self.run is None else self.run
        return {
            "unix_s": unix_s,
            "controls": self.tabs.holder,
            "configured": self.bench.configured,
            "owner": None if owner is None else owner_state(owner, status),
            "others": [owner_state(one, None) for one in self.others],
            "run": self._run_state,
            "hand": hand,
            "attention": self._attention_now(hand),
            "devices": seen.devices_state(unix_s),
            "newest": seen.newest_state(unix_s),
            "limits": seen.limits_state(),
            "notice": (self.last_line() or None) if status is None else _NOTICES.get(str(status.get("state"))),
            "problem": self.problem or None,
        }

    def _attention_now(self, hand: Mapping[str, Any] | None) -> dict[str, Any] | None:
        if hand is not None or (self.owner is not None and self.owner.kind == "by hand"):
            return self.bench.attention
        before_its_run = self.run is None and self._status is not None and self._status.get("stopped")
        return stopped_now() if before_its_run else self._attention


def _device(port: str) -> str:
    """Return the device behind the name of a port, which may be a link."""
    return port if "://" in port else os.path.realpath(port)


def _status_of(owner: Owner, since: int) -> dict[str, Any] | None:
    more = {"since": since} if owner.kind == "by hand" else {}
    try:
        return owner.ask("status", within_s=STATUS_S, **more)
    except ControlError:
        return None


async def _again(each_s: float, look: Callable[[], Any]) -> None:
    while True:
        await look()
        await asyncio.sleep(each_s)
