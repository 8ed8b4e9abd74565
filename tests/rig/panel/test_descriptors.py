"""STOP where the panel's process has no descriptor left: some are reserved for its connection and the owners'."""

import asyncio
import os
import socket
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager, suppress

import pytest

from rig.panel import app as serving
from rig.panel.connections import Connections
from tests.rig.panel.stub_panel import TOKEN, StubOwner, StubPanel
from tests.waiting import DEADLINE_S

resource = pytest.importorskip("resource")

HALF = b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n"
OF_OWNERS = 8
"""A connection and a lock for each of four owners."""


@contextmanager
def no_descriptor_left() -> Iterator[None]:
    """Open files until none more can be opened, as others in the panel's process could."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    taken: list[int] = []
    with closing(socket.socket()) as highest:
        most = highest.fileno() + 64
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(most, hard), hard))
    try:
        with suppress(OSError):
            while True:
                taken.append(os.open(os.devnull, os.O_RDONLY))
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
        for one in taken:
            os.close(one)


def _ask_owners() -> dict[str, bool]:
    with ExitStack() as opened:
        for _ in range(OF_OWNERS):
            opened.enter_context(open(os.devnull, "rb"))
    return {"ok": True}


@pytest.mark.parametrize("flood", [0, 48])
def test_stop_is_answered_and_reaches_the_owners_without_a_descriptor_left(
    flood: int, make: Callable[..., StubPanel]
) -> None:
    panel = make(StubOwner(answers={"stop": _ask_owners}))
    listener = serving._bound(0)
    port = listener.getsockname()[1]
    connections = Connections(listener, lambda headers: (b"x-rig-token", TOKEN.encode()) in headers, panel.clock)
    app = serving.application(panel.watcher, panel.bench, port, TOKEN, connections.room_for_stop)
    server = serving._Server(serving._quiet(app), connections, panel.watcher.outlet.close)
    stop = (
        f"POST /stop HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nOrigin: http://127.0.0.1:{port}\r\nX-Rig-Tab: a\r\n"
        f"X-Rig-Token: {TOKEN}\r\nContent-Type: application/json\r\nContent-Length: 2\r\n\r\n{{}}"
    ).encode()

    async def answered(ends: list[socket.socket]) -> bytes:
        serves = asyncio.create_task(server.serve(sockets=[]))
        loop = asyncio.get_running_loop()
        while not server.started:
            await asyncio.sleep(0)
        with no_descriptor_left():
            async with asyncio.timeout(DEADLINE_S):
                for end in ends:
                    await loop.sock_connect(end, ("127.0.0.1", port))
                    await loop.sock_sendall(end, stop if end is ends[-1] else HALF)
                found = await loop.sock_recv(ends[-1], 4096)
        server.should_exit = True
        await serves
        return found

    with ExitStack() as opened, asyncio.Runner(loop_factory=asyncio.SelectorEventLoop) as runner:
        opened.enter_context(closing(listener))
        ends = [opened.enter_context(closing(socket.socket())) for _ in range(flood + 1)]
        for end in ends:
            end.setblocking(False)
        found = runner.run(answered(ends))
    assert found.startswith(b"HTTP/1.1 200 "), found
    assert [do for do, _ in panel.owners[0].asked] == ["stop"]
