"""What a person sees and does on the page, in states that a server told it."""

import re
from base64 import b64decode
from collections.abc import Callable
from io import BytesIO
from typing import Any

import pytest
from PIL import Image

from tests.panel import scenes
from tests.panel.coded import coded
from tests.panel.stand_in import Asked, StandIn
from tests.waiting import until

expect = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed (make panel-test)").expect

Bench = Callable[..., StandIn]
Opened = Callable[..., Any]
WIDTHS, THEMES = (420, 799, 1440), ("light", "dark")


def _filled(one: StandIn, opened: Opened, **how: Any) -> Any:
    """A page with schedule and section that has the controls."""
    one.say("schedule", scenes.schedule(), keep=True)
    one.say("section", scenes.section(), keep=True)
    page = opened(one.address, **how)
    until(lambda: one.state["controls"])
    return page


def _of(one: StandIn, path: str) -> list[Asked]:
    return [asked for asked in one.asked if asked.path == path]


def _read(one: StandIn, force_gwt: float, doi_mm: float | None = 0.4, **other: Any) -> None:
    row = {"unix_s": one.now(), "t_s": 40.0, "force_gwt": force_gwt, "doi_mm": doi_mm, "x_mm": -0.4} | other
    row = {"height_mm": -0.398, "phase": "press", "index": 8, "purpose": "data"} | row
    one.read([[row[name] for name in scenes.COLUMNS]])


def _read_live(one: StandIn, page: Any, force_gwt: float) -> None:
    """Read until one is shown in time: on a busy machine the first may be old before the page has it."""
    found = page.locator("#read_at")
    until(lambda: _read(one, force_gwt) or found.get_attribute("data-code") == "live")


# --- what must not be missed ---


@pytest.mark.parametrize("name", ["tripping", "tripped", "stopped", "by hand, stopped"])
def test_a_trip_or_a_stop_is_a_red_notice_that_stays_and_says_what_to_do(
    name: str, bench: Bench, opened: Opened
) -> None:
    one = bench(scenes.SCENES[name]())
    told = one.state["attention"]
    page = _filled(one, opened)
    expect(page.locator("#attention")).to_have_class("banner bad")
    for of in ("where", "next", "resume"):
        words = told["resume" if of == "resume" else f"{of}_text"]
        expect(page.locator(f"#attention_{of}")).to_have_text(words)
    expect(page.locator("#attention_title")).to_contain_text(told["reason_text"], ignore_case=True)
    assert "running" not in page.locator("#controls_words").text_content()
    for button in page.locator("[data-post=pause], [data-post=go_on]").all():
        assert button.is_disabled()
    if one.state["owner"] is None:
        expect(page.locator("#controls_words")).to_have_attribute(*coded("after_contact"))
        expect(page.locator("#sensor_words")).to_have_text(re.compile(r"\d\d:\d\d:\d\d"))  # since when it is silent
    one.state["attention"] = None
    one.state |= scenes.running() | {"controls": one.state["controls"]}
    expect(page.locator("#attention")).to_be_hidden()


def test_numbers_are_the_last_ones_in_both_units_and_old_ones_have_their_age(bench: Bench, opened: Opened) -> None:
    one = bench(scenes.running())
    one.state["newest"] |= {"age_s": None, "placed_age_s": None}
    page = _filled(one, opened)
    expect(page.locator("#read_at")).to_have_attribute(*coded("unread"))
    _read_live(one, page, 12.34)
    expect(page.locator("#force_gwt")).to_have_text("12.34")
    expect(page.locator("#force_n")).to_have_text("0.1210")
    expect(page.locator("#depth_words")).to_have_text("0.400 mm (400 µm)")
    expect(page.locator("#margin_words")).to_have_text("8.05 gwt (0.0789 N)")
    expect(page.locator("#trip_words")).to_have_text("20.39 gwt (0.2000 N)")
    one.state["newest"] |= {
        "height_mm": 2.0,
        "doi_mm": None,
        "y_mm": 0.5,
        "age_s": 0.0,
        "placed_age_s": 0.0,
    }  # lifted
    expect(page.locator("#height_words")).to_have_text("2.000 mm")
    expect(page.locator("#depth_words")).to_have_text("–")
    expect(page.locator("#y_words")).to_have_text("0.50 mm")
    one.state["newest"] |= {"age_s": None, "placed_age_s": None}
    page.evaluate("(() => { const now = Date.now; Date.now = () => now() - 3600e3; })()")  # a clock that is set back
    expect(page.locator("#read_at")).to_have_attribute(*coded("old"))


HUNG_S = 3.0
HANG = f"""setTimeout(() => {{
  window.began = Date.now() / 1000;
  while (Date.now() / 1000 < window.began + {HUNG_S});
  window.ended = Date.now() / 1000;
}})"""


def test_an_old_number_turns_gray_while_the_page_itself_hangs(bench: Bench, opened: Opened) -> None:
    """By the browser's compositor: seen in pictures of the screen."""
    one = bench(scenes.running())
    one.state["newest"] |= {"age_s": None, "placed_age_s": None}
    page = opened(one.address, viewport={"width": 1280, "height": 800})
    until(lambda: one.state["controls"])
    frames: list[tuple[float, str, int]] = []
    screen, browser = page.context.new_cdp_session(page), page.context.browser.new_browser_cdp_session()
    screen.on("Page.screencastFrame", lambda one: frames.append(_frame(**one)))
    screen.send("Page.startScreencast", {"format": "png"})
    _read_live(one, page, 2.0)
    number = page.locator("#force_gwt").bounding_box()
    page.evaluate(HANG)
    until(lambda: _looked(screen, browser, frames) and frames[-1][0] - frames[0][0] > HUNG_S)
    began, ended = page.evaluate("[window.began, window.ended]")
    inside = [data for at, data, _ in frames if began < at < ended]
    assert _darkest(frames[0][1], number) < 60
    assert _darkest(inside[-1], number) > 80


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


# --- what is drawn ---

GAPS = """async ([rows, columns]) => {
  const { Buffer } = await import("/static/charts.js");
  const one = new Buffer();
  one.take({ run: "a", columns, rows });
  return one.time;
}"""


def test_nothing_is_drawn_where_nothing_was_read(bench: Bench, opened: Opened) -> None:
    one = bench(scenes.bench())
    page = opened(one.address)
    expect(page.locator("#no_plots")).to_be_visible()
    expect(page.locator("#plots canvas")).to_have_count(0)
    rows = [[t_s, 1.0, None, None, -1, "data"] for t_s in (0.0, 0.5, 9.0, 9.5)]
    columns = ["t_s", "force_gwt", "doi_mm", "x_mm", "index", "purpose"]
    times, forces, *_ = page.evaluate(GAPS, [rows, columns])
    assert times == [0.0, 0.5, 4.75, 9.0, 9.5]
    assert forces == [1.0, 1.0, None, 1.0, 1.0]


def test_the_indentor_stands_on_the_skin_as_it_is_pressed_in(bench: Bench, opened: Opened) -> None:
    one = bench(scenes.running())
    page = _filled(one, opened)
    one.state["newest"] |= {"doi_mm": 0.25, "x_mm": 0.0, "height_mm": -0.31}
    _read(one, 2.0, doi_mm=0.25, x_mm=0.0, height_mm=-0.31)
    indentor = page.locator("#section .indentor")
    expect(indentor).to_have_attribute("transform", re.compile(r"translate\(0 -0\.2[45]\d*\)"))
    expect(page.locator("#section .contact")).to_have_count(1)
    skin = page.locator("#section .skin").get_attribute("d")
    assert "L0 -0.25" in skin
    one.state["newest"] |= {"doi_mm": None, "height_mm": 1.5}
    _read(one, 0.0, doi_mm=None, x_mm=0.0, height_mm=1.5, index=-1)
    expect(indentor).to_have_attribute("transform", "translate(0 1.5)")
    expect(page.locator("#section .contact")).to_have_count(0)


# --- every width and theme ---


@pytest.mark.parametrize("width", WIDTHS)
def test_nothing_is_cut_and_stop_comes_first(width: int, bench: Bench, opened: Opened) -> None:
    for name in ("idle", "running", "stopped", "by hand"):
        one = bench(scenes.SCENES[name]())
        page = _filled(one, opened, viewport={"width": width, "height": 900})
        if name == "running":
            one.read(scenes.readings(one.now()), reset=True)
            page.locator("#plots canvas").first.wait_for()
        assert page.evaluate("document.documentElement.scrollWidth") == width, name
        cut = page.evaluate(
            """() => [...document.querySelectorAll("button, dd, h2, p, .force, label")].filter((one) =>
              one.checkVisibility() && one.id !== "what" && one.scrollWidth > one.clientWidth + 1 && one.clientWidth)
              .map((one) => one.id || one.textContent)"""
        )
        assert cut == [], name
        stop, what = page.locator("#stop").bounding_box(), page.locator("h1").bounding_box()
        lefts = {round(one.bounding_box()["x"]) for one in page.locator("main:visible .card:visible").all()}
        if width < 800:
            assert stop["width"] > 0.9 * width
            assert stop["y"] < what["y"]
            assert len(lefts) == 1


@pytest.mark.parametrize("theme", THEMES)
def test_the_page_is_accessible_in_every_state(theme: str, bench: Bench, opened: Opened) -> None:
    axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    for name, scene in scenes.SCENES.items():
        one = bench(scene())
        one.runs = scenes.runs()
        page = _filled(one, opened, color_scheme=theme)
        page.locator("#controls_words:not([data-code=waiting])").wait_for()
        if name == "idle":
            page.locator("#to_runs").click()
            page.locator("#runs_rows tr").first.wait_for()
        found = axe.run(page).response["violations"]
        assert [f"{name}: {one['id']}: {node['target']}" for one in found for node in one["nodes"]] == []
        page.close()


# --- runs and tabs ---


def test_the_page_shows_the_schedule_of_the_run_and_finds_runs_by_subject(bench: Bench, opened: Opened) -> None:
    one = bench(scenes.running())
    one.runs = scenes.runs()
    page = _filled(one, opened)
    expect(page.locator("#steps li")).to_have_count(62)
    expect(page.locator("#steps li.done")).to_have_count(10)
    expect(page.locator("#left_words")).to_contain_text("0:17:14")
    one.say("section", scenes.section() | {"run": "another"}, keep=True)
    one.say("schedule", scenes.schedule() | {"run": "another"}, keep=True)
    expect(page.locator("#steps_frame")).to_be_hidden()
    expect(page.locator("#place")).to_be_hidden()
    page.locator("#to_runs").click()
    expect(page.locator("#runs_rows tr")).to_have_count(3)
    page.locator("[name=subject]").fill("S07")
    expect(page.locator("#runs_rows tr")).to_have_count(1)


def test_a_second_tab_watches_until_it_takes_the_controls(bench: Bench, opened: Opened) -> None:
    one = bench(scenes.running())
    first = opened(one.address)
    expect(first.locator("[data-post=pause]")).to_be_enabled()
    second = opened(one.address)
    expect(second.locator("#watching")).to_be_visible()
    expect(second.locator("[data-post=pause]")).to_be_disabled()
    second.locator("#take").click()
    expect(second.locator("[data-post=pause]")).to_be_enabled()
    expect(first.locator("[data-post=pause]")).to_be_disabled()
    second.locator("[data-post=pause]").click()
    until(lambda: _of(one, "/pause"))
    expect(second.locator("#said")).to_be_hidden()


def test_a_request_that_waits_is_shown_and_not_repeated_and_a_refusal_stays(bench: Bench, opened: Opened) -> None:
    one = bench(scenes.running("paused"))
    one.state["run"]["state"] = "running"  # its journal runs on
    page = _filled(one, opened)
    words, mine = page.locator("#controls_words"), one.state["controls"]
    expect(page.locator("#what")).to_contain_text(": paused")
    one.state |= scenes.bench(controls=mine)
    one.answers["/by_hand"] = (503, {"ok": False, "problem": "the port is in use", "code": "refused"})
    one.answering.clear()
    start = page.locator("[data-post=by_hand]")
    start.click()
    expect(words).to_have_attribute(*coded("asked"))
    expect(start).to_be_disabled()
    one.answering.set()
    expect(page.locator("#said")).to_contain_text("the port is in use")
    expect(start).to_be_enabled()
    one.state |= scenes.by_hand(homed=False, zeroed=False, next="home the stage", busy="home") | {"controls": mine}
    one.state["devices"]["stage"] |= {"word": "Home", "age_s": 4.0}
    expect(words).to_have_text("busy: home; not homed; not zeroed")
    expect(page.locator("#stage_words")).to_have_text("homing")
    one.state["hand"] = None
    expect(words).to_have_attribute(*coded("no_answer"))
    expect(page.locator("[data-post=home]")).to_be_disabled()


# --- manual control ---


def test_a_click_a_tap_or_a_key_makes_exactly_one_step(bench: Bench, opened: Opened) -> None:
    one = bench(scenes.by_hand())
    page = opened(one.address, has_touch=True)
    down, steps = page.locator("#directions [data-key=s]"), 0
    page.locator("#directions [data-key=s]:enabled").wait_for()
    down.focus()
    for act in (
        lambda: down.click(delay=600),
        down.tap,
        lambda: page.keyboard.press("s"),
        lambda: page.keyboard.press("Enter"),
        lambda: [page.keyboard.down("s") for _ in range(20)],  # from the second on with `repeat`
    ):
        act()
        steps += 1
        until(lambda: len(_of(one, "/step")) >= steps)  # noqa: B023
        page.evaluate("new Promise((done) => setTimeout(done, 300))")
        assert len(_of(one, "/step")) == steps
    assert {(step.body["axis"], step.body["sign"], step.body["by_mm"]) for step in _of(one, "/step")} == {
        ("z", -1, 0.1)
    }
    page.keyboard.up("s")
    page.locator("#to_runs").click()
    page.locator("[name=subject]").press_sequentially("asdwec")
    page.locator("#to_bench").click()
    one.state["hand"] |= {"busy": "step"}
    page.locator("#directions [data-key=s]:disabled").wait_for()
    page.keyboard.press("s")
    page.evaluate("new Promise((done) => setTimeout(done, 300))")
    assert len(_of(one, "/step")) == steps

    one.state["hand"] |= {"busy": None}
    expect(page.locator("#zero_anyway")).to_be_hidden()
    page.locator("[data-post=zero]:not([data-body])").click()
    until(lambda: len(_of(one, "/zero")) == 1)
    one.state["hand"] |= {"did": "zero", "ended_by": "the sensor shows a touch"}
    page.locator("#zero_anyway").click()
    until(lambda: len(_of(one, "/zero")) == 2)
    assert [one.body for one in _of(one, "/zero")] == [{}, {"anyway": True}]
