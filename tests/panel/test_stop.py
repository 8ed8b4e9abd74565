"""STOP: it leaves before anything else a press does, whatever has focus, and the page says what came back."""

from collections.abc import Callable
from typing import Any

import pytest

from tests.panel import scenes
from tests.panel.coded import coded
from tests.panel.stand_in import StandIn
from tests.waiting import until

expect = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed (make panel-test)").expect

Bench = Callable[..., StandIn]
Opened = Callable[..., Any]
BLOCKED = """(ms) => {
  const block = (event) => {
    window.pressed = (performance.timeOrigin + event.timeStamp) / 1000;
    while (performance.timeOrigin + performance.now() < window.pressed * 1000 + ms);
    window.freed = (performance.timeOrigin + performance.now()) / 1000;
  };
  for (const name of ["pointerdown", "keydown"]) window.addEventListener(name, block, { once: true });
}"""


def _stops(one: StandIn) -> list[float]:
    return [asked.unix_s for asked in one.asked if asked.path == "/stop"]


@pytest.fixture
def running(bench: Bench) -> StandIn:
    return bench(scenes.running())


def _ready(one: StandIn, opened: Opened, **how: Any) -> Any:
    page = opened(one.address, **how)
    until(lambda: one.state["controls"])
    expect(page.locator("#stop_key")).to_have_attribute(*coded("works"))
    return page


@pytest.mark.parametrize("by", ["mouse", "touch", "key", "focused button"])
def test_stop_is_sent_and_repeated_although_the_page_hangs(by: str, running: StandIn, opened: Opened) -> None:
    page = _ready(running, opened, has_touch=True)
    running.answering.clear()
    page.evaluate(BLOCKED, 2000)
    if by == "mouse":
        page.locator("#stop").click(no_wait_after=True)
    elif by == "touch":
        page.locator("#stop").tap(no_wait_after=True)
    elif by == "key":
        page.keyboard.press("Escape")
    else:
        page.locator("#stop").focus()
        page.keyboard.press("Enter")
    until(lambda: page.evaluate("window.freed"))
    pressed, freed = page.evaluate("[window.pressed, window.freed]")
    assert pressed <= _stops(running)[0] < freed - 1
    assert len([at for at in _stops(running) if at < freed]) >= 3
    running.answering.set()
    expect(page.locator("#stop_said")).to_have_class("good")


def test_the_page_warns_of_a_stop_until_it_is_answered_or_given_up(running: StandIn, opened: Opened) -> None:
    page = _ready(running, opened)
    running.answers["/stop"] = (503, {"ok": False, "problem": "the run does not answer"})
    page.keyboard.press("Escape")
    expect(page.locator("#stop_words")).to_have_attribute(*coded("not_confirmed"))
    expect(page.locator("#stop_words")).to_contain_text(running.answers["/stop"][1]["problem"])
    expect(page.locator("#stop_said")).to_have_class("bad")
    page.locator("#stop_close").click()
    expect(page.locator("#stop_said")).to_be_hidden()
    given_up_s = running.now()
    until(lambda: running.now() > given_up_s + 1)
    assert [at for at in _stops(running) if at > given_up_s + 0.3] == []
    del running.answers["/stop"]
    page.keyboard.press("Escape")
    expect(page.locator("#stop_words")).to_have_attribute(*coded("confirmed"))


def test_a_late_answer_to_a_stop_does_not_confirm_the_next_one(running: StandIn, opened: Opened) -> None:
    page = _ready(running, opened)
    waiting: list[Any] = []
    page.route("**/stop", lambda route: waiting.append(route))
    page.keyboard.press("Escape")
    until(lambda: page.evaluate("1") and len(waiting) >= 2)  # by the page, and by its worker
    expect(page.locator("#stop_words")).to_have_attribute(*coded("not_confirmed"))
    page.locator("#stop_close").click()
    first = waiting.copy()
    page.keyboard.press("Escape")
    until(lambda: page.evaluate("1") and len(waiting) > len(first))
    for one in first:
        one.fulfill(json={"ok": True, "problem": None})
    page.evaluate("new Promise((done) => setTimeout(done, 600))")
    expect(page.locator("#stop_words")).to_have_attribute(*coded("not_confirmed"))
    for one in waiting[len(first) :]:
        one.fulfill(json={"ok": True, "problem": None})
    expect(page.locator("#stop_words")).to_have_attribute(*coded("confirmed"))


def test_stop_works_from_every_focus_and_every_tab_with_the_token(bench: Bench, opened: Opened) -> None:
    one = bench(scenes.by_hand())
    page = _ready(one, opened)
    place = page.locator("#stop").bounding_box()
    page.locator("[data-post=home]:enabled").wait_for()
    for _ in range(12):
        page.keyboard.press("Tab")
        before = len(_stops(one))
        page.keyboard.press("Escape")
        until(lambda before=before: len(_stops(one)) > before)
    page.mouse.wheel(0, 4000)
    assert page.locator("#stop").bounding_box() == place
    other = opened(one.address)
    expect(other.locator("#watching")).to_be_visible()
    other.locator("#stop").click()
    expect(other.locator("#stop_said")).to_have_class("good")
    stranger = opened(one.address.partition("#")[0])
    expect(stranger.locator("#stop_key")).to_have_attribute(*coded("no_token"))
    stranger.locator("#stop").click()
    expect(stranger.locator("#stop_words")).to_have_attribute(*coded("not_allowed"))
