"""What waits for each page: of what is shown the newest, of readings all there is room for; nobody is held up."""

import asyncio
import json
from collections.abc import Mapping
from typing import Any

from rig.panel.stream import (
    MOST_ROWS,
    SHOWN_S,
    Outlet,
    PageQueue,
    ReadingSource,
    stream,
)

RUN = ReadingSource("run", ("t_s", "force_gwt"))


def events(text: str) -> list[tuple[str, dict[str, Any]]]:
    """Kind and content of each."""
    assert text == "" or text.endswith("\n\n")
    found = []
    for block in text.split("\n\n")[:-1]:
        kind, data = block.split("\n")
        found.append((kind.removeprefix("event: "), json.loads(data.removeprefix("data: "))))
    return found


def rows_of(client: PageQueue, unix_s: float = 5.0) -> dict[str, Any]:
    ((kind, told),) = events(client.taken(unix_s))
    assert kind == "readings"
    return told


def readings(outlet: Outlet, *seconds: float) -> None:
    outlet.add([[second, 10 * second] for second in seconds])


def test_a_new_page_gets_the_present_state_and_readings() -> None:
    outlet = Outlet()
    outlet.publish("state", {"n": 1})
    outlet.publish("schedule", {"n": 2})
    outlet.publish("state", {"n": 3})
    outlet.begin(RUN)
    readings(outlet, 1.0, 2.0)
    with outlet.joined() as client:
        assert client.woken.is_set()
        assert events(client.taken(7.0)) == [
            ("state", {"n": 3}),
            ("schedule", {"n": 2}),
            ("readings", {"unix_s": 7.0, "run": "run", "hand": False, "columns": ["t_s", "force_gwt"],
                          "reset": True, "dropped": 0, "rows": [[1.0, 10.0], [2.0, 20.0]]}),
        ]  # fmt: skip
        assert not client.woken.is_set()
        assert client.taken(7.0) == ""
        readings(outlet, 3.0)
        assert client.woken.is_set()
        assert (told := rows_of(client))["rows"] == [[3.0, 30.0]]
        assert told["reset"] is False
        outlet.publish("state", {"n": 4})
        assert events(client.taken(7.0)) == [("state", {"n": 4})]
    assert outlet.clients == []


def test_a_slow_page_gets_the_newest_state_and_all_readings() -> None:
    outlet = Outlet()
    with outlet.joined() as slow:
        slow.taken(0.0)
        outlet.begin(RUN)
        for n in range(5):
            outlet.publish("state", {"n": n})
            readings(outlet, float(n))
        found = dict(events(slow.taken(0.0)))
        assert found["state"] == {"n": 4}
        assert [row[0] for row in found["readings"]["rows"]] == [0.0, 1.0, 2.0, 3.0, 4.0]


def test_readings_of_400_s_wait_for_a_page_then_the_oldest_are_dropped_and_counted() -> None:
    assert MOST_ROWS == 20_000
    outlet = Outlet()
    outlet.begin(RUN)
    with outlet.joined() as slow, outlet.joined() as quick:
        for second in range(MOST_ROWS // 50):
            readings(outlet, *(second + k / 50 for k in range(50)))
            assert len(rows_of(quick)["rows"]) == 50
        assert (len(slow.rows), slow.dropped) == (MOST_ROWS, 0)
        readings(outlet, 500.0, 501.0, 502.0)
        told = rows_of(slow)
        assert (told["dropped"], len(told["rows"])) == (3, MOST_ROWS)
        assert (told["rows"][0][0], told["rows"][-1][0]) == (0.06, 502.0)
        readings(outlet, 503.0)
        assert rows_of(slow)["dropped"] == 0
        assert rows_of(quick)["dropped"] == 0


def test_a_new_page_gets_the_readings_of_the_last_minute() -> None:
    assert SHOWN_S == 60.0
    outlet = Outlet()
    outlet.begin(RUN)
    readings(outlet, 0.0, 30.0)
    readings(outlet, 60.0)
    with outlet.joined() as client:
        assert [row[0] for row in rows_of(client)["rows"]] == [0.0, 30.0, 60.0]
    readings(outlet, 90.1)
    with outlet.joined() as client:
        assert [row[0] for row in rows_of(client)["rows"]] == [60.0, 90.1]


# --- sent ---


class Page:
    """The other end of a stream: reads as a test says."""

    def __init__(self) -> None:
        self.said: list[Mapping[str, Any]] = []
        self.leaves, self.reads = asyncio.Event(), asyncio.Event()
        self.reads.set()

    async def receive(self) -> dict[str, Any]:
        await self.leaves.wait()
        return {"type": "http.disconnect"}

    async def send(self, message: Mapping[str, Any]) -> None:
        await self.reads.wait()
        self.said.append(message)

    @property
    def text(self) -> str:
        return b"".join(message.get("body", b"") for message in self.said).decode()


async def turns() -> None:
    """Until everybody has had theirs."""
    for _ in range(20):
        await asyncio.sleep(0)


def streaming(outlet: Outlet, page: Page) -> "asyncio.Task[None]":
    async def looks_on() -> None:
        with outlet.joined() as client:
            await stream(outlet, client, page.receive, page.send, lambda: 9.0)

    return asyncio.create_task(looks_on())


def test_a_stream_sends_events_until_its_page_leaves() -> None:
    async def told() -> None:
        outlet, page = Outlet(), Page()
        task = streaming(outlet, page)
        await turns()
        assert page.said[0]["status"] == 200
        assert page.said[0]["headers"] == [(b"content-type", b"text/event-stream; charset=utf-8")]
        assert page.text.startswith("retry: 1000\n\nevent: readings\n")
        outlet.publish("state", {"n": 1})
        await turns()
        assert page.text.endswith('event: state\ndata: {"n":1}\n\n')
        page.leaves.set()
        await task
        assert outlet.clients == []

    asyncio.run(told())


def test_a_page_that_does_not_read_delays_no_other() -> None:
    async def told() -> None:
        outlet, stuck, other = Outlet(), Page(), Page()
        stuck.reads.clear()
        tasks = [streaming(outlet, stuck), streaming(outlet, other)]
        await turns()
        for n in range(50):
            outlet.publish("state", {"n": n})
            await turns()
        assert other.text.count("event: state") == 50
        assert stuck.said == []
        stuck.reads.set()
        await turns()
        assert stuck.text.count("event: state") == 1
        stuck.reads.clear()
        outlet.publish("state", {"n": 50})
        await turns()
        stuck.leaves.set()  # while something is being sent to it
        await tasks[0]
        assert len(outlet.clients) == 1
        other.leaves.set()
        await tasks[1]

    asyncio.run(told())


def test_streams_end_when_the_panel_ends() -> None:
    async def told() -> None:
        outlet, page = Outlet(), Page()
        task = streaming(outlet, page)
        await turns()
        outlet.close()
        await task
        assert page.said[-1] == {"type": "http.response.body", "body": b"", "more_body": False}

    asyncio.run(told())
