"""Steps from the page: one for each click, tap or press of a key."""

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


@pytest.fixture
def hand(bench: Bench) -> StandIn:
    return bench(scenes.by_hand())


@pytest.fixture
def page(hand: StandIn, opened: Opened) -> Any:
    page = opened(hand.address, has_touch=True, viewport={"width": 1280, "height": 1200})
    page.locator("#directions [data-key=d]:enabled").wait_for()
    return page


def _of(one: StandIn, path: str) -> list[Asked]:
    return [asked for asked in one.asked if asked.path == path]


def _steps(one: StandIn, times: int = 1) -> list[Asked]:
    return until(lambda: len(_of(one, "/step")) >= times and _of(one, "/step"))


def _quiet(page: Any) -> None:
    page.evaluate("new Promise((done) => setTimeout(done, 350))")


@pytest.mark.parametrize("key", WAYS)
@pytest.mark.parametrize("how", ["click", "tap", "key", "Enter", " "])
def test_a_direction_makes_one_step(key: str, how: str, hand: StandIn, page: Any) -> None:
    button = page.locator(f"#directions [data-key={key}]")
    if how == "click":
        button.click(delay=600)
    elif how == "tap":
        button.tap()
    elif how == "key":
        page.keyboard.press(key)
    else:
        button.focus()
        page.keyboard.press(how)
    (step,) = _steps(hand)
    _quiet(page)
    assert len(_of(hand, "/step")) == 1
    assert (step.body["axis"], step.body["sign"], step.body["by_mm"]) == (*WAYS[key], 0.1)
    assert abs(step.body["unix_s"] - step.unix_s) < 60, "in seconds of the wall clock"


@pytest.mark.parametrize("key", ["s", "Enter"])
def test_the_repeats_of_a_held_key_make_no_step(key: str, hand: StandIn, page: Any) -> None:
    page.locator("#directions [data-key=s]").focus()
    for _ in range(20):
        page.keyboard.down(key)  # from the second on with `repeat`
    page.keyboard.up(key)
    _quiet(page)
    assert len(_of(hand, "/step")) == 1


def test_a_size_is_chosen_by_its_key_and_by_mouse(hand: StandIn, page: Any) -> None:
    page.keyboard.press("6")
    page.keyboard.press("d")
    assert _steps(hand)[0].body["by_mm"] == 5
    page.locator("[name=size][value='0.01']").check()
    page.keyboard.press("d")
    assert _steps(hand, 2)[-1].body["by_mm"] == 0.01


def test_a_refused_step_is_shown(hand: StandIn, page: Any) -> None:
    hand.answers["/step"] = (409, {"ok": False, "problem": "busy: step", "code": "busy"})
    page.keyboard.press("d")
    expect(page.locator("#said")).to_have_attribute(*coded("busy"))
    expect(page.locator("#said")).to_contain_text(hand.answers["/step"][1]["problem"])


@pytest.mark.parametrize("lost", ["the controls", "the stage", "busy"])
def test_where_nothing_may_move_the_directions_are_disabled(lost: str, hand: StandIn, page: Any) -> None:
    if lost == "the controls":
        hand.state["controls"] = "another"
    else:
        hand.state["hand"] |= {"stopped": True} if lost == "the stage" else {"busy": "step"}
    page.locator("#directions [data-key=d]:disabled").wait_for()
    page.keyboard.press("d")
    _quiet(page)
    assert _of(hand, "/step") == []


def test_letters_that_are_typed_move_nothing(hand: StandIn, page: Any) -> None:
    page.locator("#to_runs").click()
    page.locator("[name=subject]").press_sequentially("asdwec")
    page.keyboard.press("Control+a")
    page.locator("#to_bench").click()
    page.keyboard.press("Control+d")
    _quiet(page)
    assert _of(hand, "/step") == []


@pytest.mark.parametrize("what", ["home", "zero", "park", "leave"])
def test_the_others_are_asked_for_once(what: str, hand: StandIn, page: Any) -> None:
    page.locator(f"[data-post={what}]").first.focus()
    page.keyboard.press("Enter")
    expect(page.locator("#said")).to_have_attribute(*coded("understood"))
    assert len(_of(hand, f"/{what}")) == 1


def test_a_zero_that_is_refused_may_be_insisted_on(hand: StandIn, page: Any) -> None:
    expect(page.locator("#zero_anyway")).to_be_hidden()
    page.locator("[data-post=zero]:not([data-body])").click()
    until(lambda: len(_of(hand, "/zero")) == 1)
    hand.state["hand"] |= {"did": "zero", "ended_by": "the sensor shows a touch"}
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
