"""The application's own: streams of events without a page that stays, paths that are none, the process that draws."""

import signal
from typing import Any

import pytest

import rig.panel.drawing as drawing
import rig.panel.drawing as drawing_process
from rig.panel.drawing import Drawer
from rig.panel.stream import Outlet
from sim.devices.clock import VirtualClock
from tests.rig.panel.stub_panel import TOKEN, StubPanel


def test_a_stream_is_of_a_tab_as_long_as_it_lasts(panel: StubPanel, monkeypatch: pytest.MonkeyPatch) -> None:
    tabs, said = panel.watcher.tabs, list[object]()
    monkeypatch.setattr(tabs, "opened", lambda tab: said.append(("opened", tab)))
    monkeypatch.setattr(tabs, "closed", lambda tab, now_s: said.append(("closed", tab, now_s)))
    panel.watcher.outlet.close()
    now_s = panel.clock.monotonic_s()
    answer = panel.get(f"/events?tab={'t' * 65}", x_rig_token=TOKEN)
    assert (answer.status_code, answer.content) == (200, b"retry: 1000\n\n")
    assert said == [("opened", "t" * 64), ("closed", "t" * 64, now_s)]
    assert panel.watcher.outlet.clients == []
    panel.get("/events", x_rig_token=TOKEN)
    assert said[2:] == [("opened", ""), ("closed", "", now_s)]


def test_to_be_told_of_a_stream_opens_none(panel: StubPanel, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(panel.watcher.tabs, "opened", lambda tab: 1 / 0)
    answer = panel.get("/events?tab=a", "HEAD", x_rig_token=TOKEN)
    assert (answer.status_code, answer.content) == (200, b"")


@pytest.mark.parametrize("path", ["/runs.json/", "/events/", "/runs"])
def test_no_path_leads_to_another(path: str, panel: StubPanel) -> None:
    assert panel.get(path).status_code == 404


class Wire:
    """The far end of the pipe: two jobs, then nobody is there."""

    def __init__(self) -> None:
        self.jobs, self.sent = ["first", "second"], list[Any]()

    def recv(self) -> str:
        if not self.jobs:
            raise EOFError
        return self.jobs.pop(0)

    def send(self, drawn: Any) -> None:
        self.sent.append(drawn)


def test_the_process_that_draws_comes_after_who_moves_something_and_is_ended_by_its_server(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    done, wire = list[object](), Wire()
    monkeypatch.setattr(drawing_process, "give_way", done.append)
    monkeypatch.setattr(drawing_process.signal, "signal", lambda number, action: done.append((number, action)))
    monkeypatch.setattr(drawing, "drawn", lambda job: {"skin": job})
    drawing_process._serve(wire)  # type: ignore[arg-type]
    assert done == [10, (signal.SIGINT, signal.SIG_IGN)]
    assert wire.sent == [{"skin": "first"}, {"skin": "second"}]


def test_a_drawer_that_is_closed_draws_nothing_more() -> None:
    drawer = Drawer(lambda: None, Outlet(), VirtualClock())
    drawer.close()
    with pytest.raises(RuntimeError, match="after shutdown"):
        drawer._thread.submit(print)
