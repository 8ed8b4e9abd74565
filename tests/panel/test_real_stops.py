"""STOP in the page, through the real server, ends a real run: its byte leaves while the page hangs."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from studies.pictures.panel_page import panel
from tests.waiting import until

pytest.importorskip("playwright.sync_api", reason="Playwright is not installed (make panel-test)")


def test_stop_is_sent_while_the_page_hangs_and_the_run_is_recorded_as_aborted(
    opened: Callable[..., Any], tmp_path: Path
) -> None:
    """One stop in a plan, an approach and a report; `studies.faults.stops --click` makes fifty, and times them."""
    from studies.faults.stops import HANGS_MS, Benches, clicker

    with panel(tmp_path) as (_, url):
        page = opened(url, has_touch=True)
        page.locator("#stop:enabled").wait_for()
        benches = Benches(tmp_path, "grbl", clicker(page))
        with benches.served():
            stops = [benches.stopped(n, phase) for n, phase in enumerate(("plan", "approach", "report"))]
    assert [stop.recorded for stop in stops] == ["aborted planning", "aborted", "done reporting"]
    assert [stop.code for stop in stops] == [130, 130, 130]
    assert all(0 < stop.latency_s < HANGS_MS / 1000 for stop in stops), stops


def test_stop_goes_first_to_its_own_port_over_a_connection_that_is_open(
    opened: Callable[..., Any], tmp_path: Path
) -> None:
    with panel(tmp_path) as (_, url):
        page = opened(url)
        page.locator("#stop:enabled").wait_for()
        port = page.evaluate("document.documentElement.dataset.stopPort")
        answers: list[dict[str, Any]] = []
        watched = page.context.new_cdp_session(page)
        watched.on("Network.responseReceived", lambda one: answers.append(one["response"]))
        watched.send("Network.enable")
        page.keyboard.press("Escape")
        own = f":{port}/stop"
        first = until(lambda: page.evaluate("1") and next((one for one in answers if one["url"].endswith(own)), None))
        assert (first["status"], first["connectionReused"]) == (409, True), "nothing is there to be stopped"
        assert port not in ("", url.rpartition(":")[2].partition("/")[0])
