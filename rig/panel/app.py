"""The panel served on loopback, until it is told to end."""

import asyncio
import contextlib
import secrets
import signal
import socket
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import uvicorn

from rig.panel.app import application
from rig.panel.by_hand_process import ByHandProcess
from rig.panel.drawn.drawer import Drawer
from rig.panel.owners import Find
from rig.panel.seen.seen_bench import SeenBench
from rig.panel.watcher import Watcher
from rig.plan.config import load_config
from rig.session.control.announcements import announced
from rig.session.control.control_socket import quick_switches
from rig.transport.clock import WallClock

HOST = "127.0.0.1"
_BACKLOG = 64
_SIGNALS = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]


@dataclass(frozen=True)
class Offered:
    """What is served: runs below a folder, a bench where there is a configuration; the port, 0 for any."""

    out: Path
    config: Path | None = None
    port: int = 0


class Panel:
    """One server; `url` is known before it begins, and holds the token where no log has it."""

    def __init__(self, offered: Offered, find: Find = announced) -> None:
        """Raises BadInputError, OSError where the port is taken."""
        config = None if offered.config is None else load_config(offered.config)
        self._socket = _bound(offered.port)
        self.port = int(self._socket.getsockname()[1])
        self._token = secrets.token_urlsafe(32)
        self._bench = ByHandProcess(offered.config, find)
        bench = SeenBench(offered.config, config)
        self._watcher = Watcher(offered.out.absolute(), bench, find, WallClock())
        self._watcher.last_words = lambda: self._bench.last_words
        self._drawer = Drawer(lambda: self._watcher.job, self._watcher.outlet, self._watcher.clock)
        app = application(self._watcher, self._bench, self.port, self._token)
        self._server = _Server(_quiet(app), self._watcher.outlet.close)

    @property
    def url(self) -> str:
        """For the browser's line, or to be clicked at; what is behind the # no server is told."""
        return f"http://{HOST}:{self.port}/#token={self._token}"

    def serve(self) -> None:
        """Until Ctrl-C, another signal that asks for it, or `end`; the bench is left then."""
        try:
            with quick_switches(), contextlib.suppress(KeyboardInterrupt):  # where signals do not come to the loop
                asyncio.run(self._serve())
        finally:
            self._socket.close()
            self._drawer.close()
            self._bench.leave()
            self._bench.forget()

    def end(self) -> None:
        """From any thread."""
        self._server.should_exit = True

    async def _serve(self) -> None:
        """Whatever fails ends the panel, and is raised."""
        self._end_at_signals()
        serving = asyncio.create_task(self._server.serve(sockets=[self._socket]))
        looking = [asyncio.create_task(one.look_on()) for one in (self._watcher, self._drawer)]
        await asyncio.wait([serving, *looking], return_when=asyncio.FIRST_COMPLETED)
        self._server.should_exit = True
        await serving
        for task in looking:
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await task

    def _end_at_signals(self) -> None:
        for number in _SIGNALS:
            with contextlib.suppress(
                NotImplementedError, RuntimeError, ValueError
            ):  # elsewhere than in a main thread
                asyncio.get_running_loop().add_signal_handler(number, self.end)


class _Server(uvicorn.Server):
    """Signals are the panel's; streams, which have no end of their own, are closed before it waits for them."""

    def __init__(self, config: uvicorn.Config, close: Callable[[], None]) -> None:
        super().__init__(config)
        self._close = close

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        """They are left alone."""
        yield

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """End."""
        self._close()
        await super().shutdown(sockets)


def _quiet(app: object) -> uvicorn.Config:
    """No log of what is asked, no header that says who serves; nothing that is not needed on loopback."""
    return uvicorn.Config(
        app,  # type: ignore[arg-type]
        loop="asyncio",
        http="h11",
        ws="none",
        lifespan="off",
        access_log=False,
        log_config=None,
        proxy_headers=False,
        server_header=False,
        timeout_graceful_shutdown=2,
    )


def _bound(port: int) -> socket.socket:
    """Raises OSError, which names the port."""
    found = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        found.bind((HOST, port))
        found.listen(_BACKLOG)
    except OSError as error:
        found.close()
        raise OSError(error.errno, error.strerror, f"{HOST}:{port}") from None
    return found
