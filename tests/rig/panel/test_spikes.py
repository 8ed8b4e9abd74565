"""Simulated spikes on the page: what the port of `rig serve --afferents` sends, and nothing that grows."""

import asyncio
import json
from typing import Any

import pytest

from rig.errors import BadInputError
from rig.panel import spikes
from rig.panel.spikes import MOST_SPIKES, SHOWN_S, SpikeView, port_number
from rig.panel.stream import Outlet
from sim.devices.clock import VirtualClock
from tests.error_codes import raises
from tests.program import Program

GREETING = ["# synthetic spikes, not data: SA1-1 RA-1 SA1-2", "time_s,kind,afferent"]


@pytest.fixture
def clock() -> VirtualClock:
    return VirtualClock(1000.0, 50.0)


def published(outlet: Outlet) -> Any:
    """What a new page is sent."""
    with outlet.joined() as client:
        event = client.latest.get("spikes")
    return None if event is None else json.loads(event.partition("data: ")[2])


def seen(clock: VirtualClock, *lines: str) -> tuple[SpikeView, Outlet]:
    outlet = Outlet()
    found = SpikeView(1, outlet, clock)
    found.take([*GREETING, *lines])
    found.publish()
    return found, outlet


def test_spikes_have_rows_and_ages(clock: VirtualClock) -> None:
    _, outlet = seen(clock, "49.5,spike,RA-1", "49.75,sync,", "49.9,spike,SA1-2")
    assert published(outlet) == {
        "unix_s": 1000.0,
        "connected": False,
        "afferents": ["SA1-1", "RA-1", "SA1-2"],
        "rows": [[1, 0.5], [2, 0.1]],
    }


@pytest.mark.parametrize(
    "line",
    [
        "",
        "49.9",
        "x,spike,RA-1",
        "49.9,spike,QQ-1",
        "49.9,other,RA-1",
        "# : <b>",
        f"{50 - SHOWN_S},spike,RA-1",
        "nan,spike,RA-1",
    ],
)
def test_what_cannot_be_shown_is_left_out(clock: VirtualClock, line: str) -> None:
    _, outlet = seen(clock, line)
    assert published(outlet)["rows"] == []
    assert set(published(outlet)["afferents"]) <= {"SA1-1", "RA-1", "SA1-2"}


def test_the_number_of_spikes_has_an_end(clock: VirtualClock) -> None:
    _, outlet = seen(clock, *[f"{49 + k / 1e5:.5f},spike,RA-1" for k in range(MOST_SPIKES + 100)])
    assert len(published(outlet)["rows"]) == MOST_SPIKES
    assert published(outlet)["rows"][-1][1] == pytest.approx(50 - 49 - (MOST_SPIKES + 99) / 1e5, abs=1e-4)


def test_nothing_new_is_not_published_again(clock: VirtualClock) -> None:
    found, outlet = seen(clock)
    outlet.forget("spikes")
    found.publish()
    assert published(outlet) is None


def test_another_server_begins_anew(clock: VirtualClock) -> None:
    found, outlet = seen(clock, "49.5,spike,RA-1")
    found.take(["# synthetic spikes, not data: PC-1"])
    found.publish()
    assert (published(outlet)["afferents"], published(outlet)["rows"]) == (["PC-1"], [])


def test_a_lost_connection_is_made_again(clock: VirtualClock, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(spikes, "AGAIN_S", 0.0)
    monkeypatch.setattr(spikes, "EACH_S", 0.0)
    outlet, met, writers = Outlet(), list[int](), list[asyncio.StreamWriter]()

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        met.append(len(met))
        writers.append(writer)
        writer.write(f"# synthetic: SA1-{met[-1]}\n49.5,spike,SA1-{met[-1]}\n49.6,sp".encode())
        await writer.drain()
        if met[-1] < 2:
            writer.close()

    async def watch() -> None:
        server = await asyncio.start_server(serve, "127.0.0.1", 0)
        following = asyncio.create_task(SpikeView(server.sockets[0].getsockname()[1], outlet, clock).follow())
        while (last := published(outlet)) is None or last["afferents"] != ["SA1-2"] or not last["connected"]:
            await asyncio.sleep(0)
        following.cancel()
        await asyncio.gather(following, return_exceptions=True)
        server.close()
        for writer in writers:
            writer.close()
            await asyncio.gather(writer.wait_closed(), return_exceptions=True)

    asyncio.run(watch())
    assert published(outlet)["rows"] == [[0, 0.5]]


@pytest.mark.parametrize("text", ["", "5000", "tcp://127.0.0.1:0", "tcp://127.0.0.1:70000", "tcp://10.0.0.1:5000"])
def test_a_port_is_that_of_rig_serve(program: Program, text: str) -> None:
    with raises(BadInputError, "bad_value"):
        port_number(text)
    ended = program("panel", "--no-browser", "--spikes", text, "--json")
    assert (ended.code, ended.error_code) == (2, "bad_value")


def test_the_port_of_rig_serve_is_understood() -> None:
    assert port_number("tcp://127.0.0.1:40961") == 40961
