"""A panel without a port."""

from collections.abc import Callable
from pathlib import Path

import pytest

from rig.control.stop import SentStop
from rig.devices.registry import stage_ports
from rig.panel import stops
from rig.panel.access import Address
from rig.panel.app import applications
from rig.panel.watcher import BenchView, Watcher
from rig.plan.config import Config
from rig.settings import BenchSettings
from sim.devices.clock import VirtualClock
from tests.rig.panel.stub_panel import PORT, STOP_PORT, TOKEN, StubHandProcess, StubOwner, StubPanel
from tests.waiting import DEADLINE_S


@pytest.fixture(autouse=True)
def sent(monkeypatch: pytest.MonkeyPatch) -> list[BenchSettings]:
    """Stops that the panel sends itself, to a stage that cannot be reached; never to a port of this machine."""
    direct: list[BenchSettings] = []

    def send(settings: BenchSettings) -> SentStop:
        direct.append(settings)
        return SentStop(stage_ports(settings.stage), problems=["there is no such port"])

    monkeypatch.setattr(stops, "send_stop", send)
    monkeypatch.setattr(stops, "BESIDE_S", DEADLINE_S)
    return direct


@pytest.fixture
def make(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., StubPanel]:
    """Make a panel: make(*owners, configured=True). On however slow a machine it waits for the answer to a stop."""
    monkeypatch.setattr(stops, "_ANSWER_S", DEADLINE_S)

    def made(*owners: StubOwner, configured: bool = True) -> StubPanel:
        there, clock, bench = list(owners), VirtualClock(1000.0), StubHandProcess()
        of_the_bench = BenchView(tmp_path / "rig.toml", Config()) if configured else BenchView()
        watcher = Watcher(tmp_path / "runs", of_the_bench, lambda: there, clock)
        watcher.owners = there
        apps = applications(watcher, bench, Address(PORT, STOP_PORT, TOKEN))
        return StubPanel(there, watcher, bench, clock, *apps)

    return made


@pytest.fixture
def panel(make: Callable[..., StubPanel]) -> StubPanel:
    """One beside a run that goes on."""
    return make(StubOwner())
