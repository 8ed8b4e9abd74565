"""A stage that is open from the announcement of a run to its end: in every phase a stop is one write."""

import io
import json
import threading
from collections.abc import Callable
from contextlib import nullcontext
from typing import Any

import pytest

import rig.devices.make_drivers as drivers
from rig.bench.virtual import virtual_stage
from rig.cli.script_execution import RunOwner
from rig.control.owned_stage import OwnedStage, StopSwitch
from rig.devices.base import Stage
from rig.devices.registry import BUILT_IN, StageKind, find
from rig.errors import RigError
from rig.plan.config import Config
from rig.transport import LoopbackTransport, NotOwnedError, PortOwner, TransportError
from sim.devices import SerialLine
from sim.devices.clock import VirtualClock
from tests.error_codes import raises
from tests.rig.hand_bench import is_stop
from tests.waiting import DEADLINE_S, until

KINDS = BUILT_IN["stage"]
PHASES = ("planning", "asking", "running", "reporting")


class Port(LoopbackTransport):
    """One opening of the port; what it says it did stands in `done`."""

    def __init__(self, ports: "Ports", line: SerialLine) -> None:
        super().__init__(line, ports.clock, "stage")
        self._ports, self.dropped, self.refuses, self.chatter = ports, False, False, b""

    def write(self, data: bytes) -> None:
        if self.refuses:
            raise TransportError("unplugged")
        self._ports.done.append(data.hex())
        super().write(data)

    def read(self, timeout_s: float) -> bytes:
        if self.dropped:
            raise TransportError("the other side closed the connection")
        self._ports.reads.append(timeout_s)
        assert len(self._ports.reads) < 10_000
        return self.chatter or super().read(timeout_s)

    def close(self) -> None:
        self._ports.done.append("closed")
        super().close()


class Ports:
    """The virtual stage of a kind behind its ports."""

    def __init__(self, kind: str, clock: VirtualClock) -> None:
        self.config = Config.model_validate({"stage": {"kind": kind}})
        self.clock, self.line = clock, SerialLine(clock, self.config.stage.baud)
        virtual_stage(clock, self.line, self.config)
        own = find(StageKind, kind).ports(self.config.stage)
        self.lines = dict(zip(own, (self.line, *self.line.further), strict=True))
        self.done: list[str] = []
        self.reads: list[float] = []
        self.opened: list[Port] = []
        self.refused = 0  # so many openings are
        self.owner: PortOwner | None = None

    def open(self, port: str, baud: int, *, owned: bool = True, **settings: Any) -> Port:
        assert baud == self.config.stage.baud
        if self.owner is not None and owned:
            raise NotOwnedError("in use", self.owner)
        if self.refused:
            self.refused -= 1
            raise TransportError("in use", "in_use")
        self.done.append("opened")
        self.opened.append(Port(self, self.lines[port]))
        return self.opened[-1]

    def held(self) -> OwnedStage:
        clock: Any = self.clock
        return OwnedStage(self.config, clock)


@pytest.fixture
def of_kind(monkeypatch: pytest.MonkeyPatch, clock: VirtualClock) -> Callable[[str], Ports]:
    def made(kind: str) -> Ports:
        ports = Ports(kind, clock)
        monkeypatch.setattr(drivers, "open_port", ports.open)
        return ports

    return made


@pytest.fixture
def ports(of_kind: Callable[[str], Ports]) -> Ports:
    return of_kind("grbl")


def _ready(stage: Stage) -> Stage:
    stage.connect()
    stage.home()
    return stage


def _sent(lines: str) -> list[str]:
    return [line["hex"] for line in map(json.loads, lines.splitlines()) if line["dir"] == "tx"]


@pytest.mark.parametrize("phase", PHASES)
@pytest.mark.parametrize("kind", [*KINDS, "dry-run"])
def test_a_stop_in_every_phase_of_a_run_is_the_next_byte_on_the_wire(
    of_kind: Callable[[str], Ports], kind: str, phase: str
) -> None:
    """Nothing is opened for it, and what was under way goes out no more."""
    ports = of_kind("grbl" if kind == "dry-run" else kind)
    hand = None if kind == "dry-run" else ports.held().open()
    interrupts: list[int] = []
    owner, log = RunOwner(StopSwitch(hand, lambda: interrupts.append(1)), virtual=hand is None), io.StringIO()
    owner.switch.begins()
    stage: Stage | None = None
    if phase in ("running", "reporting"):
        owner.at("running")
        stage = None if hand is None else _ready(hand.lend(log))
    if phase == "reporting":
        owner.at("reporting")
        if hand is not None:
            hand.give_back()
    before, said = list(ports.done), len(log.getvalue())
    with owner.asking() if phase == "asking" else nullcontext():
        assert owner.answers["stop"]({"do": "stop"}) == {"stopped": True}
    assert interrupts == [1]
    if hand is None:
        assert ports.done == []
        return
    assert is_stop(kind, bytes.fromhex(ports.done[len(before)]))
    assert ports.done.count("opened") == len(ports.lines), "before anybody could ask, and never again"
    recorded, elsewhere = log.getvalue()[said:], owner.switch.kept
    if phase != "running":
        recorded, elsewhere = elsewhere, recorded
    assert _sent(recorded)[0] == ports.done[len(before)]
    assert elsewhere == ""
    if stage is not None:
        assert not stage.homed
        sent = len(ports.done)
        with pytest.raises(RigError) as refused:
            stage.move_to(z_mm=-1.0, speed_mm_s=1.0)
        assert refused.value.code in ("stopped", "needs_reset", "not_homed")
        assert len(ports.done) == sent


# --- lent, and given back ---


@pytest.mark.parametrize("used", [True, False], ids=["stopped", "never homed"])
def test_the_port_of_a_stopped_stage_is_released_at_once(ports: Ports, used: bool) -> None:
    """Whoever stands there need not wait for a report; another stop opens it again."""
    hand = ports.held().open()
    stage = hand.lend(io.StringIO())
    if used:
        _ready(stage)
        stage.stop()
    hand.give_back()
    assert ports.done[-1] == "closed"
    hand.stop()
    assert ports.done[-2:] == ["opened", "2118"]
    assert len(ports.opened) == 2


def test_a_port_not_yet_open_is_opened_for_a_stop_or_a_run(ports: Ports) -> None:
    """A run of which only the report is missing needs no stage."""
    hand = ports.held()
    hand.stop()
    assert (ports.done, _sent(hand.kept)) == (["opened", "2118"], ["2118"])
    other = ports.held()
    other.give_back()
    assert _ready(other.lend(io.StringIO())).homed


# --- ports that drop ---


def test_a_port_lost_during_planning_is_opened_again_for_the_run(ports: Ports) -> None:
    hand, log = ports.held().open(), io.StringIO()
    ports.opened[0].dropped = True
    stage = _ready(hand.lend(log))
    assert ports.done[:3] == ["opened", "closed", "opened"]
    assert stage.homed
    hand.stop()
    assert (ports.done[-1], len(ports.opened)) == ("2118", 2)


@pytest.mark.parametrize("way", ["dropped", "refuses"])
def test_a_stop_on_a_lost_port_is_sent_through_a_new_one(ports: Ports, way: str) -> None:
    """A wire that was cut takes a byte all the same: it is told at once, and looked at then."""
    hand = ports.held().open()
    setattr(ports.opened[0], way, True)
    hand.stop()
    assert ports.done == ["opened", *(["2118"] if way == "dropped" else []), "closed", "opened", "2118"]


def test_a_stop_is_sent_through_a_port_that_never_stops_receiving(ports: Ports) -> None:
    hand = ports.held().open()
    ports.opened[0].chatter = b"x"
    hand.stop()
    assert ports.done == ["opened", "2118"]


def test_a_port_lost_during_the_report_is_opened_again_once_for_a_stop(ports: Ports) -> None:
    hand = ports.held().open()
    ports.opened[0].dropped = True
    _ready(hand.lend(io.StringIO()))
    hand.give_back()
    hand.stop()
    assert len(ports.opened) == 2, "that of the run is well, and the one before it is forgotten"
    ports.opened[1].dropped = True
    hand.stop()
    assert len(ports.opened) == 3
    assert ports.done[-4:] == ["2118", "closed", "opened", "2118"]


def test_a_stop_reads_nothing_from_a_port_in_use_by_its_own_run(ports: Ports) -> None:
    hand = ports.held().open()
    _ready(hand.lend(io.StringIO()))
    ports.opened[0].dropped = True
    ports.reads.clear()
    hand.stop()
    assert (ports.reads, len(ports.opened)) == ([], 1)


def test_a_stop_waits_for_a_port_that_is_briefly_in_use(ports: Ports) -> None:
    hand, ports.refused = ports.held(), 2
    began_s = ports.clock.monotonic_s()
    hand.stop()
    assert ports.done == ["opened", "2118"]
    assert ports.clock.monotonic_s() - began_s == pytest.approx(0.01)


def test_a_stop_whose_port_stays_in_use_is_an_error_after_three_seconds(ports: Ports) -> None:
    hand, ports.refused = ports.held(), 10_000
    began_s = ports.clock.monotonic_s()
    with raises(TransportError, "in_use"):
        hand.stop()
    assert ports.clock.monotonic_s() - began_s == pytest.approx(3.0, abs=0.01)
    assert hand.gate.closed
    with raises(TransportError, "in_use"):
        hand.open()


def test_a_stop_while_the_port_opens_is_the_only_byte_sent(ports: Ports) -> None:
    hand = ports.held()
    thread = threading.Thread(target=hand.stop)
    with hand._changing:
        thread.start()
        until(lambda: hand.gate.closed)
        hand.open()
        assert ports.done == ["opened"]
        with raises(TransportError, "stopped"):
            hand.lend(io.StringIO()).connect()
    thread.join(DEADLINE_S)
    assert ports.done == ["opened", "2118"]
    assert hand.gate.closed


def test_a_stop_is_sent_through_a_port_that_another_process_took(ports: Ports) -> None:
    """And nothing else does: the port is given back at once."""
    hand = ports.held().open()
    hand.close()
    ports.owner = PortOwner(4711)
    began_s = ports.clock.monotonic_s()
    for _ in range(2):
        hand.stop()
    assert ports.done == ["opened", "closed", *["opened", "2118", "closed"] * 2]
    assert ports.clock.monotonic_s() == began_s
    with pytest.raises(NotOwnedError):
        hand.lend(io.StringIO())


def test_a_stop_retries_a_gateway_that_accepts_one_connection(ports: Ports) -> None:
    hand, ports.owner, ports.refused = ports.held(), PortOwner(4711), 3
    hand.stop()
    assert ports.done == ["opened", "2118", "closed"]
