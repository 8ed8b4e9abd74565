"""The bench by hand through the panel: over HTTP, its own process and the wires, to a board and a balance."""

from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from rig.clock import WallClock
from rig.control.client import announced
from rig.panel.app import Panel
from rig.units import GWT_N
from tests.rig.real_time.panel_page import Serve, Stream, post, serve
from tests.waiting import until

__all__ = ["serve"]  # a fixture


def step(panel: Panel, by_mm: float) -> tuple[int, Any]:
    about = {"axis": "x", "sign": 1 if by_mm > 0 else -1, "by_mm": abs(by_mm)}
    return post(panel, "/step", {**about, "unix_s": WallClock().unix_s()})


def hand(page: Stream, look: Any) -> dict[str, Any]:
    """What is told of by hand as soon as it is as it is looked for."""
    return page.until("state", lambda told: told["hand"] and look(told["hand"]))["hand"]


def test_a_person_homes_zeroes_steps_stops_and_leaves_through_the_panel(
    apart: tuple[str, str, Path], serve: Serve
) -> None:
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
        assert state["limits"]["trip_gwt"] == pytest.approx(2.0 / GWT_N)
        assert page.until("readings", lambda told: told["hand"] and told["rows"])["dropped"] == 0

        assert post(panel, "/home")[0] == 200
        homed = hand(page, lambda told: told["homed"] and told["busy"] is None)
        assert post(panel, "/zero", {"anyway": True})[0] == 200
        hand(page, lambda told: told["zeroed"] and told["busy"] is None)

        assert step(panel, -1.0)[0] == 200
        assert step(panel, -1.0)[0] == 409, "none is queued"
        rest = hand(page, lambda told: told["busy"] is None and (told["x_mm"] or 0.0) < homed["x_mm"] - 0.9)
        assert rest["x_mm"] == pytest.approx(homed["x_mm"] - 1.0, abs=0.003)

        assert post(panel, "/stop", tab="another")[0] in (200, 503)
        after = page.until("state", lambda told: told["hand"] and told["hand"]["stopped"])
        assert after["hand"]["homed"] is False
        assert (after["attention"]["status"], bool(after["attention"]["where_text"])) == ("aborted", True)
        assert step(panel, 1.0)[0] == 409

        assert post(panel, "/leave")[0] == 200
        assert announced() == []
        page.until("state", lambda told: told["hand"] is None)
        assert post(panel, "/by_hand")[0] == 200  # at once: the ports are free
    panel.end()
    until(lambda: announced() == [])


def test_manual_control_names_a_missing_port(rig_toml: Any, serve: Serve) -> None:
    panel = serve(config=rig_toml("/dev/ttyNOWHERE6"))
    code, answer = post(panel, "/by_hand")
    assert code == 503
    assert "/dev/ttyNOWHERE6" in answer["problem"]
    assert "\n" not in answer["problem"]
