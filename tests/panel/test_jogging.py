"""A dead man's jog from the page: as long as a button or key is held and the hand on it beyond doubt."""

from collections.abc import Callable
from typing import Any

import pytest

from tests.panel import scenes
from tests.panel.coded import coded
from tests.panel.stand_in import Asked, StandIn
from tests.waiting import until

expect = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed (make panel-test)").expect

Bench = Callable[..., StandIn]
Opened = Callable[..., Any]
WAYS = {"a": ("x", -1), "d": ("x", 1), "c": ("y", -1), "e": ("y", 1), "w": ("z", 1), "s": ("z", -1)}
HANG = "(ms) => { const end = performance.now() + ms; while (performance.now() < end); }"


@pytest.fixture
def hand(bench: Bench) -> StandIn:
    return bench(scenes.by_hand())


@pytest.fixture
def page(hand: StandIn, opened: Opened) -> Any:
    page = opened(hand.address, has_touch=True, viewport={"width": 1280, "height": 1200})
    page.locator("#jog [data-key=d]:enabled").wait_for()
    return page


def _of(one: StandIn, path: str) -> list[Asked]:
    return [asked for asked in one.asked if asked.path == path]


def _held(one: StandIn, times: int = 3) -> list[Asked]:
    return until(lambda: len(_of(one, "/hold")) >= times and _of(one, "/hold"))


def _let_go(one: StandIn, page: Any, code: str) -> None:
    """Released once, nothing sent after it, and told why."""
    until(lambda: _of(one, "/release"))
    expect(page.locator("#jog_words")).to_have_attribute(*coded(code))
    page.evaluate("new Promise((done) => setTimeout(done, 350))")
    paths = [path for path in one.paths() if path in ("/hold", "/release")]
    assert paths[-1] == "/release"
    assert paths.count("/release") == 1
    assert _of(one, "/release")[0].body == {"press": _of(one, "/hold")[-1].body["press"]}


@pytest.mark.parametrize("key", WAYS)
def test_a_button_is_held_by_the_mouse(key: str, hand: StandIn, page: Any) -> None:
    page.locator(f"#jog [data-key={key}]").hover()
    page.mouse.down()
    held = _held(hand)
    expect(page.locator(f"#jog [data-key={key}]")).to_have_class("held")
    page.mouse.up()
    _let_go(hand, page, "ready")
    axis, sign = WAYS[key]
    assert {(one.body["axis"], one.body["sign"], one.body["speed_mm_s"]) for one in held} == {(axis, sign, 1)}
    assert len({one.body["press"] for one in held}) == 1
    sent = [one.body["unix_s"] for one in held]
    assert sent == sorted(set(sent))
    assert all(abs(one.body["unix_s"] - one.unix_s) < 60 for one in held), "in seconds of the wall clock"


@pytest.mark.parametrize("key", WAYS)
def test_a_button_is_held_by_its_key(key: str, hand: StandIn, page: Any) -> None:
    page.keyboard.down(key)
    page.keyboard.down(key)  # as a keyboard repeats it
    held = _held(hand)
    page.keyboard.up(key)
    _let_go(hand, page, "ready")
    assert {(one.body["axis"], one.body["sign"]) for one in held} == {WAYS[key]}


@pytest.mark.parametrize("key", ["Space", "Enter"])
def test_a_focused_button_is_held_by_the_keys_of_buttons(key: str, hand: StandIn, page: Any) -> None:
    page.locator("#jog [data-key=w]").focus()
    page.keyboard.down(key)
    page.keyboard.down(key)
    _held(hand)
    page.keyboard.up(key)
    _let_go(hand, page, "ready")


@pytest.mark.parametrize("end", ["touchEnd", "touchCancel"])
def test_a_button_is_held_by_a_finger(end: str, hand: StandIn, page: Any) -> None:
    box = page.locator("#jog [data-key=a]").bounding_box()
    touch = page.context.new_cdp_session(page)
    point = {"x": box["x"] + 20, "y": box["y"] + 20}
    touch.send("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": [point]})
    _held(hand)
    touch.send("Input.dispatchTouchEvent", {"type": end, "touchPoints": []})
    _let_go(hand, page, "ready")


@pytest.mark.parametrize(
    ("what", "code"),
    [
        ("window.dispatchEvent(new Event('blur'))", "another_window"),
        ("window.dispatchEvent(new PageTransitionEvent('pagehide'))", "page_left"),
        (
            "Object.defineProperty(document, 'hidden', {value: true});"
            "document.dispatchEvent(new Event('visibilitychange'))",
            "tab_hidden",
        ),
        ("document.querySelector('#jog [data-key=d]').blur()", "ready"),
    ],
)
def test_whatever_casts_doubt_on_the_hand_lets_go(what: str, code: str, hand: StandIn, page: Any) -> None:
    page.locator("#jog [data-key=d]").hover()
    page.mouse.down()
    _held(hand)
    page.evaluate(what)
    _let_go(hand, page, code)


SECONDS = {
    "another direction": lambda page: page.keyboard.down("w"),
    "any letter": lambda page: page.keyboard.down("q"),
    "Cmd": lambda page: page.keyboard.down("Meta"),  # macOS reports no release of a letter beside it
    "STOP": lambda page: page.keyboard.down("Escape"),
    "the mouse on another direction": lambda page: _mouse_down(page, "#jog [data-key=w]"),
    "the mouse on its own direction": lambda page: _mouse_down(page, "#jog [data-key=d]"),
    "the mouse elsewhere": lambda page: _mouse_down(page, "[data-post=home]"),
    "the menu of the mouse": lambda page: _mouse_down(page, "#traces_title", "right"),
}


def _mouse_down(page: Any, on: str, button: str = "left") -> None:
    page.locator(on).hover()
    page.mouse.down(button=button)


@pytest.mark.parametrize("second", SECONDS)
def test_a_second_key_or_button_lets_go_and_begins_nothing(second: str, hand: StandIn, page: Any) -> None:
    page.keyboard.down("d")
    _held(hand)
    SECONDS[second](page)
    _let_go(hand, page, "two_buttons")
    page.mouse.up()
    page.keyboard.up("d")
    assert {one.body["axis"] for one in _of(hand, "/hold")} == {"x"}


@pytest.mark.parametrize("key", ["q", "d", "Space", "Enter"])
def test_a_second_key_lets_go_of_a_button_that_the_mouse_holds(key: str, hand: StandIn, page: Any) -> None:
    _mouse_down(page, "#jog [data-key=d]")
    _held(hand)
    page.keyboard.down(key)
    _let_go(hand, page, "two_buttons")


def _dispatched(page: Any, kind: str, key: str, code: str) -> None:
    how = {"key": key, "code": code, "bubbles": True}
    page.evaluate("([kind, how]) => document.body.dispatchEvent(new KeyboardEvent(kind, how))", [kind, how])


def test_the_button_of_a_held_key_is_marked_on_any_keyboard(hand: StandIn, page: Any) -> None:
    """A keyboard with another layout has the letter d elsewhere."""
    _dispatched(page, "keydown", "d", "KeyH")
    _held(hand)
    expect(page.locator("#jog .held")).to_have_count(1)
    expect(page.locator("#jog [data-key=d]")).to_have_class("held")
    _dispatched(page, "keyup", "d", "KeyH")
    _let_go(hand, page, "ready")


def test_a_page_that_was_held_up_lets_go(hand: StandIn, page: Any) -> None:
    page.keyboard.down("d")
    _held(hand)
    page.evaluate(HANG, 1000)
    _let_go(hand, page, "page_too_slow")


def test_what_is_refused_ends_the_press_until_it_is_pressed_anew(hand: StandIn, page: Any) -> None:
    hand.answers["/hold"] = (409, {"ok": False, "problem": "touched at 0.06 gwt", "code": "touched"})
    page.keyboard.down("s")
    _let_go(hand, page, "touched")
    expect(page.locator("#jog_words")).to_contain_text(hand.answers["/hold"][1]["problem"])
    page.keyboard.down("s")
    assert len(_of(hand, "/hold")) == 1, "a repeated key is no new press"
    page.keyboard.up("s")
    del hand.answers["/hold"]
    page.keyboard.down("s")
    first, *later = _held(hand)
    assert {one.body["press"] for one in later} != {first.body["press"]}
    assert later[0].body["press"] > first.body["press"]


def test_a_closed_page_sends_nothing_more(hand: StandIn, page: Any) -> None:
    page.keyboard.down("d")
    _held(hand)
    page.close(run_before_unload=True)
    until(lambda: _of(hand, "/release"))
    assert [path for path in hand.paths() if path in ("/hold", "/release")][-1] == "/release"


def test_holds_do_not_pile_up(hand: StandIn, page: Any) -> None:
    """One is under way at a time: what waited in a queue would come when the button was let go."""
    hand.answering.clear()
    page.keyboard.down("d")
    _held(hand, 1)
    page.evaluate("new Promise((done) => setTimeout(done, 600))")
    assert len(_of(hand, "/hold")) == 1
    hand.answering.set()
    _held(hand, 3)
    page.keyboard.up("d")


@pytest.mark.parametrize("lost", ["the controls", "the server", "the stage"])
def test_a_press_ends_with_what_it_needs(lost: str, hand: StandIn, page: Any) -> None:
    page.keyboard.down("d")
    _held(hand)
    if lost == "the controls":
        hand.state["controls"] = "another"
    elif lost == "the server":
        hand.talking.clear()
    else:
        hand.state["hand"]["stopped"] = True
    _let_go(hand, page, "not_allowed")


def test_speed_is_chosen_by_key_and_by_mouse(hand: StandIn, page: Any) -> None:
    page.locator("[name=speed]:checked").focus()
    page.keyboard.press("ArrowLeft")
    page.keyboard.down("d")
    assert _held(hand)[0].body["speed_mm_s"] == 0.5
    page.keyboard.up("d")
    page.locator("[name=speed][value='0.1']").check()
    before = len(_of(hand, "/hold"))
    page.keyboard.down("d")
    assert _held(hand, before + 1)[-1].body["speed_mm_s"] == 0.1


def test_letters_that_are_typed_move_nothing(hand: StandIn, page: Any) -> None:
    page.locator("#to_runs").click()
    page.locator("[name=subject]").press_sequentially("asdwec")
    page.keyboard.press("Control+a")
    page.locator("#to_bench").click()
    page.keyboard.press("Control+d")
    assert _of(hand, "/hold") == []


@pytest.mark.parametrize("what", ["home", "zero", "leave"])
def test_the_others_are_asked_for_once(what: str, hand: StandIn, page: Any) -> None:
    page.locator(f"[data-post={what}]").first.focus()
    page.keyboard.press("Enter")
    expect(page.locator("#said")).to_have_attribute(*coded("understood"))
    assert len(_of(hand, f"/{what}")) == 1


def test_a_zero_that_is_refused_may_be_insisted_on(hand: StandIn, page: Any) -> None:
    hand.answers["/zero"] = (409, {"ok": False, "problem": "the sensor shows a touch", "code": "touched"})
    expect(page.locator("#zero_anyway")).to_be_hidden()
    page.locator("[data-post=zero]:not([data-body])").click()
    expect(page.locator("#said")).to_have_attribute(*coded("touched"))
    expect(page.locator("#said")).to_contain_text(hand.answers["/zero"][1]["problem"])
    page.locator("#zero_anyway").click()
    until(lambda: len(_of(hand, "/zero")) == 2)
    assert [one.body for one in _of(hand, "/zero")] == [{}, {"anyway": True}]


@pytest.mark.parametrize(("state", "may"), [("running", "pause"), ("paused", "go_on"), ("planning", None)])
def test_of_a_run_only_what_has_a_meaning_can_be_asked(
    state: str, may: str | None, bench: Bench, opened: Opened
) -> None:
    one = bench(scenes.running(state))
    page = opened(one.address)
    expect(page.locator("#controls_words")).to_have_attribute(*coded(state))
    until(lambda: one.state["controls"])
    for name in ("pause", "go_on"):
        button = page.locator(f"[data-post={name}]")
        if name == may:
            button.click()
            until(lambda name=name: _of(one, f"/{name}"))
        else:
            expect(button).to_be_disabled()
