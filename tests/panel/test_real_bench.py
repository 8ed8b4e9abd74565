"""The page on the real server, with the bench by hand behind `rig serve`; a server that hangs."""

import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from rig.control.client import announced
from studies.faults.stops import Benches
from studies.pictures.panel_page import panel
from tests.panel.coded import coded
from tests.waiting import until

expect = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed (make panel-test)").expect
pytestmark = pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="needs signals")
Opened = Callable[..., Any]


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Benches]:
    """A fast board and a balance with the finger, in a process of their own."""
    monkeypatch.setenv("RIG_STATE_DIR", str(tmp_path / "state"))
    benches = Benches(tmp_path, "grbl")
    with benches.served():
        yield benches


def test_keys_step_the_real_stage_and_a_server_that_hangs_turns_the_page_gray(
    bench: Benches, opened: Opened, tmp_path: Path
) -> None:
    with panel(tmp_path, "--config", str(bench.config)) as (number, url):
        page = opened(url)
        page.locator("[data-post=by_hand]").click()
        page.locator("[data-post=home]:enabled").click()
        hand = until(lambda: next((one for one in announced() if one.kind == "by hand"), None))

        def at_rest(name: str) -> dict[str, Any] | None:
            status = hand.ask("status")
            return status if status[name] and status["busy"] is None and status["x_mm"] is not None else None

        before = until(lambda: at_rest("homed"))
        page.locator("[data-post=zero]:enabled").first.click()
        until(lambda: at_rest("zeroed"))
        page.locator("#directions [data-key=a]:enabled").wait_for()
        page.keyboard.press("5")
        page.keyboard.press("a")
        after = until(lambda: (found := at_rest("homed")) and found["x_mm"] < before["x_mm"] - 0.9 and found)
        assert after["x_mm"] > before["x_mm"] - 1.1

        expect(page.locator("#read_at")).to_have_attribute(*coded("live"))
        os.kill(number, signal.SIGSTOP)
        try:
            expect(page.locator("#read_at")).to_have_attribute(*coded("old"))
            expect(page.locator("#no_server")).to_have_attribute(*coded("lost"))
            page.locator("#stop").click()
            expect(page.locator("#stop_said")).to_have_class("bad")
        finally:
            os.kill(number, signal.SIGCONT)
        expect(page.locator("#stop_said")).to_have_class("good")
        until(lambda: hand.ask("status")["stopped"])
        expect(page.locator("#no_server")).to_be_hidden()
        expect(page.locator("#attention_title")).to_have_attribute(*coded("aborted"))
