"""STOP: it leaves before anything else a click does, by any key's focus, and says what came back."""

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
def test_it_leaves_though_the_page_hangs_right_after(by: str, running: StandIn, opened: Opened) -> None:
    page = _ready(running, opened, has_touch=True)
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
    page.wait_for_function("() => window.freed")
    pressed, freed = page.evaluate("[window.pressed, window.freed]")
    assert pressed <= _stops(running)[0] < freed - 1
    expect(page.locator("#stop_said")).to_have_class("good")
    expect(page.locator("#stop_words")).to_have_attribute(*coded("confirmed"))


def test_the_time_that_is_told_is_that_of_the_answer_not_of_the_page(running: StandIn, opened: Opened) -> None:
    page = _ready(running, opened)
    page.evaluate(BLOCKED, 2000)
    page.locator("#stop").click(no_wait_after=True)
    expect(page.locator("#stop_words")).to_have_attribute(*coded("confirmed"))
    told_ms = int(page.locator("#stop_said").get_attribute("data-after_ms"))
    assert 0 < told_ms < 2000, "while it hung"


def test_it_is_repeated_though_the_page_hangs(running: StandIn, opened: Opened) -> None:
    page = _ready(running, opened)
    running.answering.clear()
    page.evaluate(BLOCKED, 3000)
    page.locator("#stop").click(no_wait_after=True)
    page.wait_for_function("() => window.freed")
    freed = page.evaluate("window.freed")
    assert len([at for at in _stops(running) if at < freed]) >= 4


def test_unanswered_it_says_so_loudly_and_keeps_trying(running: StandIn, opened: Opened) -> None:
    page = _ready(running, opened)
    running.answering.clear()
    page.locator("#stop").click()
    expect(page.locator("#stop_said")).to_have_class("bad")
    expect(page.locator("#stop_words")).to_have_attribute(*coded("not_confirmed"))
    until(lambda: len(_stops(running)) >= 8)
    running.answering.set()
    expect(page.locator("#stop_said")).to_have_class("good")
    asked = len(_stops(running))
    page.locator("#stop_close").click()
    expect(page.locator("#stop_said")).to_be_hidden()
    page.keyboard.press("Escape")
    until(lambda: len(_stops(running)) > asked)


def test_it_is_loud_without_its_worker(running: StandIn, browser: Any, opened: Opened) -> None:
    """By the page alone, whose request has no end of its own."""
    with browser.new_context() as context:
        context.add_init_script("window.Worker = class { postMessage() {} };")
        page = _ready(running, opened, context=context)
        running.answering.clear()
        page.locator("#stop").click()
        expect(page.locator("#stop_words")).to_have_attribute(*coded("not_confirmed"))
        running.answering.set()


def test_it_is_loud_though_it_is_pressed_again_and_again(running: StandIn, opened: Opened) -> None:
    """Within less than the time after which one press becomes loud."""
    page = _ready(running, opened)
    running.answering.clear()
    page.evaluate(
        """() => {
          const press = () => new KeyboardEvent("keydown", { key: "Escape", bubbles: true });
          window.pressing = setInterval(() => document.body.dispatchEvent(press()), 100);
        }"""
    )
    expect(page.locator("#stop_words")).to_have_attribute(*coded("not_confirmed"))
    expect(page.locator("#stop_said")).to_have_class("bad")
    page.evaluate("clearInterval(window.pressing)")
    assert page.locator("#stop_said").evaluate("(one) => one.className") == "bad"
    running.answering.set()
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


def test_trying_ends_when_the_person_says_so(running: StandIn, opened: Opened) -> None:
    page = _ready(running, opened)
    running.answers["/stop"] = (503, {"ok": False, "problem": "the run does not answer"})
    page.locator("#stop").click()
    expect(page.locator("#stop_words")).to_have_attribute(*coded("not_confirmed"))
    expect(page.locator("#stop_words")).to_contain_text(running.answers["/stop"][1]["problem"])
    page.locator("#stop_close").click()
    expect(page.locator("#stop_said")).to_be_hidden()
    before = running.now()
    until(lambda: running.now() > before + 1)
    assert [at for at in _stops(running) if at > before + 0.3] == []


def test_a_server_that_is_gone_is_as_loud(running: StandIn, opened: Opened) -> None:
    page = _ready(running, opened)
    page.route("**/stop", lambda route: route.abort())
    page.keyboard.press("Escape")
    expect(page.locator("#stop_words")).to_have_attribute(*coded("not_confirmed"))
    expect(page.locator("#stop_said")).to_have_class("bad")


@pytest.mark.parametrize(
    ("status", "problem", "how", "code"),
    [
        (409, "nothing is running", "good", "answered"),
        (403, "token: expected another", "bad", "not_allowed"),
    ],
)
def test_other_answers_are_told_as_they_are(
    status: int, problem: str, how: str, code: str, running: StandIn, opened: Opened
) -> None:
    page = _ready(running, opened)
    running.answers["/stop"] = (status, {"ok": False, "problem": problem})
    page.locator("#stop").click()
    expect(page.locator("#stop_words")).to_have_attribute(*coded(code))
    expect(page.locator("#stop_words")).to_contain_text(problem)
    expect(page.locator("#stop_said")).to_have_class(how)


@pytest.mark.parametrize("view", ["bench", "runs"])
def test_its_key_works_whatever_has_focus_and_it_stands_in_one_place(view: str, bench: Bench, opened: Opened) -> None:
    one = bench(scenes.by_hand())
    page = _ready(one, opened)
    place = page.locator("#stop").bounding_box()
    page.locator(f"#to_{view}").click()
    page.locator("[data-post=home]:enabled" if view == "bench" else "#filters").wait_for()
    for _ in range(20):
        page.keyboard.press("Tab")
        before = len(_stops(one))
        page.keyboard.press("Escape")
        until(lambda before=before: len(_stops(one)) > before)
    page.mouse.wheel(0, 4000)
    assert page.locator("#stop").bounding_box() == place


@pytest.mark.parametrize("width", [700, 1280])
def test_what_became_of_a_stop_covers_no_card_and_leaves_the_button_in_place(
    width: int, running: StandIn, opened: Opened
) -> None:
    page = _ready(running, opened, viewport={"width": width, "height": 800})
    place = page.locator("#stop").bounding_box()
    page.locator("#stop").click()
    expect(page.locator("#stop_said")).to_have_class("good")
    assert page.locator("#stop").bounding_box() == place
    said = page.locator("#stop_said").bounding_box()
    cards = page.locator("main:visible > *").evaluate_all("all => all.map((one) => one.getBoundingClientRect().top)")
    assert cards
    assert min(cards) >= said["y"] + said["height"]


def test_a_held_key_stops_once(running: StandIn, opened: Opened) -> None:
    page = _ready(running, opened)
    page.keyboard.down("Escape")
    expect(page.locator("#stop_said")).to_have_class("good")
    asked = len(_stops(running))
    for _ in range(5):
        page.keyboard.down("Escape")  # as a keyboard repeats it
    page.keyboard.up("Escape")
    page.keyboard.press("Escape")
    until(lambda: len(_stops(running)) > asked)
    assert len(_stops(running)) <= asked + 3


def test_a_tab_that_only_watches_stops_too(running: StandIn, opened: Opened) -> None:
    running.state["controls"] = "another"
    page = opened(running.address)
    expect(page.locator("#watching")).to_be_visible()
    page.locator("#stop").click()
    expect(page.locator("#stop_said")).to_have_class("good")


def test_it_needs_no_new_connection(running: StandIn, opened: Opened) -> None:
    """Other programs may flood the server with theirs."""
    running.state["controls"] = "another"  # it asks for nothing else before
    page = opened(running.address)
    until(lambda: running.stays)
    page.locator("#watching").wait_for()
    page.locator("#stop").click()
    expect(page.locator("#stop_said")).to_have_class("good")
    assert set(running.stays) & {one.connection for one in running.asked if one.path == "/stop"}


def test_without_a_token_it_says_that_it_does_not_work(running: StandIn, opened: Opened) -> None:
    page = opened(running.address.partition("#")[0])
    expect(page.locator("#stop_key")).to_have_attribute(*coded("no_token"))
    page.locator("#stop").click()
    expect(page.locator("#stop_words")).to_have_attribute(*coded("not_allowed"))
    expect(page.locator("#stop_said")).to_have_class("bad")
