"""A browser for the panel's page: `make panel-test` gets Playwright and names these tests, or they are skipped."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from studies.pictures.chromium import FLAGS, MISSING, chromium
from tests.panel.stand_in import StandIn, stand_in
from tests.waiting import DEADLINE_S

try:
    from playwright.sync_api import Browser, BrowserContext, Page, expect, sync_playwright
except ImportError:
    sync_playwright = None


HERE = Path(__file__).parent


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """What needs the browser is skipped where there is none, or where these tests are not asked for by name."""
    reason = MISSING if chromium() is None else "Playwright is not installed (make panel-test installs it)"
    named = any(Path(place.partition("::")[0]).resolve().is_relative_to(HERE) for place in config.args)
    if not named:
        reason = "not named (make panel-test)"
    if sync_playwright is None or chromium() is None or not named:
        for item in items:
            if "/panel/" in item.nodeid and "browser" in item.fixturenames:
                item.add_marker(pytest.mark.skip(reason=reason))


@pytest.fixture(scope="module")
def browser() -> "Iterator[Browser]":
    """Chromium, without a window. Until Playwright ends, its event loop keeps asyncio out of this thread."""
    expect.set_options(timeout=1000 * DEADLINE_S)
    with sync_playwright() as playwright:
        found = playwright.chromium.launch(executable_path=chromium(), args=list(FLAGS))
        yield found
        found.close()


@pytest.fixture
def opened(browser: "Browser") -> "Iterator[Callable[..., Page]]":
    """Opens an address in a window of its own; in the end no page may have complained of an error."""
    complaints: list[str] = []
    with ExitStack() as stack:

        def open_page(address: str, context: "BrowserContext | None" = None, **how: Any) -> "Page":
            if context is None:
                context = browser.new_context(**how)
                stack.callback(context.close)
                context.set_default_timeout(1000 * DEADLINE_S)
            page = context.new_page()
            page.on("pageerror", lambda error: complaints.append(str(error)))
            page.on("console", lambda said: said.type == "error" and complaints.append(said.text))
            page.goto(address)
            return page

        yield open_page
    assert [one for one in complaints if "Failed to load resource" not in one] == []


@pytest.fixture
def bench() -> Iterator[Callable[[dict[str, Any]], StandIn]]:
    """Begins a server that says what it is told to."""
    with ExitStack() as stack:
        yield lambda state: stack.enter_context(stand_in(state))
