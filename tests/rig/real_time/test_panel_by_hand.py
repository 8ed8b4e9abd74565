"""The bench by hand through the panel: over HTTP, its own process and the wires, to a board and a balance."""

import threading
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from rig.clock import WallClock
from rig.control.client import announced
from rig.panel.app import Panel
from tests.rig.real_time.panel_page import Serve, Stream, post, serve
from tests.waiting import DEADLINE_S, until

__all__ = ["serve"]  # a fixture


class Button:
    """One that is held down, said ten times a second by a thread of its own until it is let go.

    On a busy machine a hold may be too late: then it is pressed anew, as a person would.
    """

    def __init__(self, panel: Panel, axis: str, sign: int, press: int) -> None:
        self._panel, self._about = panel, {"axis": axis, "sign": sign, "speed_mm_s": 2.0}
        self.press, self.heard = press, 0
        self._up = threading.Event()
        self._thread = threading.Thread(target=self._held)
        self._thread.start()

    def _held(self) -> None:
        clock = WallClock()
        while not self._up.is_set():
            code, _ = post(self._panel, "/hold", {**self._about, "press": self.press, "unix_s": clock.unix_s()})
            self.heard += code == 200
            self.press += code != 200
            clock.wait_s(0.1)

    def up(self) -> None:
        self._up.set()
        self._thread.join(DEADLINE_S)


def hand(page: Stream, look: Any) -> dict[str, Any]:
    """What is told of by hand as soon as it is as it is looked for."""
    return page.until("state", lambda told: told["hand"] and look(told["hand"]))["hand"]


def test_a_person_works_through_the_panel(apart: tuple[str, str, Path], serve: Serve) -> None:
    *_, config = apart
    panel = serve(config=config)
    with closing(Stream(panel)) as page:
        assert page.until("state", bool)["configured"] is True
        assert post(panel, "/home")[0] == 409
        assert post(panel, "/by_hand") == (200, {"ok": True, "problem": None})
        assert post(panel, "/by_hand")[0] == 200  # it is there
        (owner,) = announced()
        state = page.until("state", lambda told: told["hand"] and told["newest"]["force_gwt"] is not None)
        assert (state["owner"]["kind"], state["owner"]["pid"], state["hand"]["homed"]) == (
            "by hand",
            owner.pid,
            False,
        )
        assert state["limits"]["trip_n"] == pytest.approx(2.0)
        assert page.until("readings", lambda told: told["hand"] and told["rows"])["dropped"] == 0

        assert post(panel, "/home")[0] == 200
        homed = hand(page, lambda told: told["homed"] and told["busy"] is None)
        assert post(panel, "/zero", {"anyway": True})[0] == 200
        hand(page, lambda told: told["zeroed"] and told["busy"] is None)

        button = Button(panel, "x", -1, press=1)
        hand(page, lambda told: (told["x_mm"] or homed["x_mm"]) < homed["x_mm"] - 0.2)
        button.up()  # and nothing is said any more: as where a page has gone
        rest = hand(page, lambda told: told["busy"] is None)
        assert rest["x_mm"] < homed["x_mm"]
        assert post(panel, "/release", {"press": button.press})[0] == 200
        assert button.heard > 0

        assert post(panel, "/stop", tab="another")[0] in (200, 503)
        assert hand(page, lambda told: told["stopped"])["homed"] is False
        refused = post(panel, "/hold", {"axis": "x", "sign": 1, "speed_mm_s": 1.0, "press": 999,
                                        "unix_s": WallClock().unix_s()})  # fmt: skip
        assert refused[0] == 409

        assert post(panel, "/leave")[0] == 200
        assert announced() == []
        page.until("state", lambda told: told["hand"] is None)
        assert post(panel, "/by_hand")[0] == 200  # at once: the ports are free
    panel.end()
    until(lambda: announced() == [])


def test_ports_that_are_not_there_are_told_of(rig_toml: Any, serve: Serve) -> None:
    panel = serve(config=rig_toml("/dev/ttyNOWHERE6"))
    code, answer = post(panel, "/by_hand")
    assert code == 503
    assert "/dev/ttyNOWHERE6" in answer["problem"]
    assert "\n" not in answer["problem"]
