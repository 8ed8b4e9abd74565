"""What the page shows: both units, what is old grey and dated; other tabs, no server, no token."""

import re
from base64 import b64decode
from collections.abc import Callable
from io import BytesIO
from typing import Any

import pytest
from PIL import Image

from tests.panel import scenes
from tests.panel.coded import coded
from tests.panel.stand_in import StandIn, stand_in
from tests.waiting import until

expect = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed (make panel-test)").expect

Bench = Callable[..., StandIn]
Opened = Callable[..., Any]
OPACITY = "getComputedStyle(document.querySelector('#numbers .veil')).opacity"


def _fresh(one: StandIn, force_gwt: float, **other: Any) -> None:
    row = {"unix_s": one.now(), "t_s": 40.0, "force_gwt": force_gwt, "doi_mm": 0.4127, "x_mm": -0.4, **other}
    row = {"height_mm": -0.398, "phase": "press", "index": 8, "purpose": "data"} | row
    one.read(
        [
            list(
                map(
                    row.get,
                    ("unix_s", "t_s", "force_gwt", "doi_mm", "x_mm", "height_mm", "phase", "index", "purpose"),
                )
            )
        ]
    )


def _with_nothing_read(bench: Bench, opened: Opened, **how: Any) -> tuple[StandIn, Any]:
    """A page that has the controls, beside a run of which no reading has come yet."""
    one = bench(scenes.running())
    one.state["newest"]["age_s"] = None
    page = opened(one.address, **how)
    until(lambda: one.state["controls"])
    return one, page


def test_force_and_depth_are_told_in_both_units(bench: Bench, opened: Opened) -> None:
    one, page = _with_nothing_read(bench, opened)
    _fresh(one, 12.34)
    expect(page.locator("#force_gwt")).to_have_text("12.34")
    expect(page.locator("#force_n")).to_have_text("0.1210")
    expect(page.locator("#depth_words")).to_have_text("0.413 mm (413 µm)")
    expect(page.locator("#margin_words")).to_have_text("8.05 gwt (0.0789 N)")
    expect(page.locator("#trip_words")).to_have_text("20.39 gwt (0.2000 N)")
    expect(page.locator("#margin")).to_have_attribute("aria-valuenow", "61")
    expect(page.locator("#x_words")).to_have_text("−0.40 mm")
    _fresh(one, -0.001)
    expect(page.locator("#force_gwt")).to_have_text("0.00")
    _fresh(one, -19.0)  # pull counts like push
    expect(page.locator("#margin_words")).to_have_text("1.39 gwt (0.0136 N)")


def test_what_is_older_than_a_second_is_grey_and_dated(bench: Bench, opened: Opened) -> None:
    one, page = _with_nothing_read(bench, opened)
    _fresh(one, 2.0)
    expect(page.locator("#read_at")).to_have_attribute(*coded("live"))
    assert page.evaluate(OPACITY) == "0"
    expect(page.locator("#read_at")).to_have_attribute(*coded("old"))
    assert page.evaluate(OPACITY) == "1"
    assert "old" in page.locator("#numbers").get_attribute("class")


def test_before_the_first_reading_nothing_has_the_color_of_a_live_one(bench: Bench, opened: Opened) -> None:
    color = "(id) => getComputedStyle(document.getElementById(id)).color"
    one, page = _with_nothing_read(bench, opened)
    expect(page.locator("#read_at")).to_have_attribute(*coded("unread"))
    unread = page.evaluate(color, "read_at")
    assert unread == page.evaluate(color, "what")
    _fresh(one, 2.0)
    expect(page.locator("#read_at")).to_have_attribute(*coded("live"))
    assert page.evaluate(color, "read_at") != unread


def test_what_comes_late_was_never_live(bench: Bench, opened: Opened) -> None:
    """Events that lay in a queue for five seconds: they are as old as they say, not as the moment they came."""
    one = bench(scenes.running())
    one.before_s = 5.0
    page = opened(one.address)
    expect(page.locator("#read_at")).to_have_attribute(*coded("old"))
    expect(page.locator("#no_server")).to_have_attribute(*coded("lost"))
    expect(page.locator("#controls_words")).to_have_attribute(*coded("running"))
    assert page.locator("[data-post=pause]").is_disabled()


def test_a_clock_that_was_set_back_makes_nothing_young(bench: Bench, opened: Opened) -> None:
    one, page = _with_nothing_read(bench, opened)
    _fresh(one, 2.0)
    expect(page.locator("#read_at")).to_have_attribute(*coded("live"))
    page.evaluate("(() => { const now = Date.now; Date.now = () => now() - 3600e3; })()")
    one.talking.clear()
    expect(page.locator("#read_at")).to_have_attribute(*coded("old"))
    expect(page.locator("#no_server")).to_be_visible()


def test_an_old_number_is_greyed_while_the_page_itself_hangs(bench: Bench, opened: Opened) -> None:
    """By the browser's compositor, as the page itself does nothing any more: seen in pictures of the screen."""
    one, page = _with_nothing_read(bench, opened, viewport={"width": 1280, "height": 800})
    frames: list[tuple[float, str, int]] = []
    screen, browser = page.context.new_cdp_session(page), page.context.browser.new_browser_cdp_session()
    screen.on("Page.screencastFrame", lambda one: frames.append(_frame(**one)))
    screen.send("Page.startScreencast", {"format": "png"})
    _fresh(one, 2.0)
    expect(page.locator("#read_at")).to_have_attribute(*coded("live"))
    number = page.locator("#force_gwt").bounding_box()
    page.evaluate(HANG)
    until(lambda: _looked(screen, browser, frames) and frames[-1][0] - frames[0][0] > HUNG_S)
    began, ended = page.evaluate("[window.began, window.ended]")
    inside = [data for at, data, _ in frames if began < at < ended]
    assert _darkest(frames[0][1], number) < 60
    assert _darkest(inside[-1], number) > 80


HUNG_S = 3.0
HANG = f"""setTimeout(() => {{
  window.began = Date.now() / 1000;
  while (Date.now() / 1000 < window.began + {HUNG_S});
  window.ended = Date.now() / 1000;
}})"""


def _frame(metadata: dict[str, Any], data: str, sessionId: int) -> tuple[float, str, int]:
    return metadata["timestamp"], data, sessionId


def _looked(screen: Any, browser: Any, frames: list[tuple[float, str, int]]) -> bool:
    """What waits is taken; the next picture is sent when the last one was."""
    if frames:
        screen.send("Page.screencastFrameAck", {"sessionId": frames[-1][2]})
    browser.send("Browser.getVersion")
    return bool(frames)


def _darkest(frame: str, box: dict[str, float]) -> int:
    picture = Image.open(BytesIO(b64decode(frame))).convert("L")
    part = picture.crop((box["x"], box["y"], box["x"] + box["width"], box["y"] + box["height"]))
    return part.getextrema()[0]


def test_a_server_that_is_silent_is_told_of_and_found_again(bench: Bench, opened: Opened) -> None:
    one = bench(scenes.running())
    page = opened(one.address)
    expect(page.locator("[data-post=pause]")).to_be_enabled()
    one.talking.clear()
    expect(page.locator("#no_server")).to_have_attribute(*coded("lost"))
    expect(page.locator("#no_server")).to_be_visible()
    expect(page.locator("#what")).to_have_attribute(*coded("lost"))
    expect(page.locator("[data-post=pause]")).to_be_disabled()
    one.talking.set()
    expect(page.locator("#no_server")).to_be_hidden()
    expect(page.locator("[data-post=pause]")).to_be_enabled()


def test_a_server_that_ended_is_looked_for(opened: Opened) -> None:
    with stand_in(scenes.running()) as one:
        page = opened(one.address)
        expect(page.locator("[data-post=pause]")).to_be_enabled()
    expect(page.locator("#no_server")).to_be_visible()
    with stand_in(scenes.bench(), one.port):
        expect(page.locator("#no_server")).to_be_hidden()
        expect(page.locator("#what")).to_have_attribute(*coded("nothing"))


def test_a_page_without_a_token_shows_nothing_live_and_says_so(bench: Bench, opened: Opened) -> None:
    one = bench(scenes.running())
    page = opened(one.address.partition("#")[0])
    expect(page.locator("#no_token")).to_be_visible()
    expect(page.locator("#stop_key")).to_have_attribute(*coded("no_token"))
    expect(page.locator("#what")).to_have_attribute(*coded("no_token"))
    expect(page.locator("#no_server")).to_be_hidden()
    assert page.locator("[data-post=pause]").is_disabled()
    assert one.asked == [], "it asked for the controls"
    page.goto(one.address)  # only what stands behind the # changes: nothing is loaded anew
    expect(page.locator("#no_token")).to_be_hidden()
    expect(page.locator("#stop_key")).to_have_attribute(*coded("works"))
    expect(page.locator("#controls_words")).to_have_attribute(*coded("running"))
    expect(page.locator("[data-post=pause]")).to_be_enabled()
    assert "token" not in page.url


def test_a_second_tab_watches_until_it_takes_the_controls(bench: Bench, opened: Opened) -> None:
    one = bench(scenes.running())
    first = opened(one.address)
    expect(first.locator("[data-post=pause]")).to_be_enabled()
    second = opened(one.address)
    expect(second.locator("#watching")).to_be_visible()
    expect(second.locator("[data-post=pause]")).to_be_disabled()
    expect(second.locator("#stop")).to_be_enabled()
    second.locator("#take").click()
    expect(second.locator("[data-post=pause]")).to_be_enabled()
    expect(first.locator("#watching")).to_be_visible()
    expect(first.locator("[data-post=pause]")).to_be_disabled()


def test_a_page_that_is_loaded_again_is_the_same_tab_and_a_copy_is_another(bench: Bench, opened: Opened) -> None:
    one = bench(scenes.running())
    page = opened(one.address)
    until(lambda: one.state["controls"])
    own = page.evaluate("document.documentElement.dataset.tab")
    page.reload()
    expect(page.locator("[data-post=pause]")).to_be_enabled()
    assert page.evaluate("document.documentElement.dataset.tab") == own
    with page.expect_popup() as copied:
        page.evaluate("void window.open('/')")  # takes over what the tab keeps, as a copied tab does
    expect(copied.value.locator("#watching")).to_be_visible()


def test_a_tab_that_nobody_sees_lets_its_stream_go(bench: Bench, opened: Opened) -> None:
    """A browser has six connections for all its tabs, and STOP needs one."""
    one = bench(scenes.running())
    page = opened(one.address)
    until(lambda: len(one.streams) == 1)
    hidden = "Object.defineProperty(document, 'visibilityState', {value: '%s', configurable: true});"
    page.evaluate(hidden % "hidden" + "document.dispatchEvent(new Event('visibilitychange'))")
    until(lambda: one.streams == [])
    page.evaluate(hidden % "visible" + "document.dispatchEvent(new Event('visibilitychange'))")
    until(lambda: len(one.streams) == 1)


def test_steps_are_listed_with_what_is_done_and_what_is_now(bench: Bench, opened: Opened) -> None:
    one = bench(scenes.running())
    one.say("schedule", scenes.schedule(), keep=True)
    page = opened(one.address)
    steps = page.locator("#steps li")
    expect(steps).to_have_count(62)
    expect(page.locator("#steps li.done")).to_have_count(10)
    expect(page.locator("#steps [aria-current=step]")).to_contain_text(scenes.schedule()["steps"][10]["condition"])
    expect(page.locator("#left_words")).to_contain_text("0:17:14")
    expect(page.locator("#done_words")).to_have_text(re.compile(r"^8\D+60\D"))
    assert page.locator("#steps_frame").evaluate("(one) => one.scrollTop") > 0


def test_the_schedule_and_section_of_another_run_are_not_shown(bench: Bench, opened: Opened) -> None:
    one = bench(scenes.running())
    one.say("schedule", scenes.schedule() | {"run": "another"}, keep=True)
    one.say("section", scenes.section() | {"run": "another"}, keep=True)
    page = opened(one.address)
    expect(page.locator("#left_words")).to_contain_text("0:17:14")
    expect(page.locator("#steps_frame")).to_be_hidden()
    expect(page.locator("#place")).to_be_hidden()
    one.say("section", scenes.section(), keep=True)
    expect(page.locator("#place")).to_be_visible()


def test_the_indentor_stands_where_the_last_reading_has_it(bench: Bench, opened: Opened) -> None:
    one = bench(scenes.running())
    one.say("section", scenes.section(), keep=True)
    page = opened(one.address)
    until(lambda: one.state["controls"])
    _fresh(one, 2.0, x_mm=1.25, height_mm=-0.3)
    expect(page.locator("#section .indentor")).to_have_attribute("transform", "translate(1.25 -0.3)")
    expect(page.locator("#section .contact")).to_have_count(1)


@pytest.mark.parametrize(("wanted", "shown"), [("subject=S07", 1), ("", 3)])
def test_runs_are_listed_and_asked_for_by_filters(wanted: str, shown: int, bench: Bench, opened: Opened) -> None:
    one = bench(scenes.bench())
    one.runs = scenes.runs()
    page = opened(one.address)
    page.locator("#to_runs").click()
    expect(page.locator("#runs_rows tr")).to_have_count(3)
    expect(page.locator("#stop")).to_be_visible()
    page.locator("[name=subject]").fill(wanted.partition("=")[2])
    expect(page.locator("#runs_rows tr")).to_have_count(shown)
    link = page.locator("#runs_rows a").first
    assert link.get_attribute("href").endswith("/report.html")
