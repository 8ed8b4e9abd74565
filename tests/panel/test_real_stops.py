"""STOP in the page, through the real server, ends a real run: its byte leaves while the page hangs."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from studies.pictures.panel_page import panel

pytest.importorskip("playwright.sync_api", reason="Playwright is not installed (make panel-test)")


def test_the_byte_leaves_while_the_page_hangs_and_the_run_is_recorded_as_aborted(
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
