"""Labels, roles and contrast by axe-core, in every state of the page, light and dark; and the keyboard alone."""

from collections.abc import Callable
from typing import Any

import pytest

from tests.panel import scenes
from tests.panel.stand_in import StandIn
from tests.waiting import until

THEMES = ("light", "dark")
FOCUSABLE = "a[href], button:not(:disabled), input:not(:disabled), [tabindex='0']"


def _filled(one: StandIn) -> None:
    one.say("schedule", scenes.schedule(), keep=True)
    one.say("prediction", scenes.prediction(), keep=True)
    one.say("section", scenes.section(), keep=True)


def _violations(page: Any) -> list[str]:
    axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    found = axe.run(page).response["violations"]
    return [f"{one['id']}: {node['target']} {node.get('failureSummary')}" for one in found for node in one["nodes"]]


@pytest.mark.parametrize("theme", THEMES)
@pytest.mark.parametrize("name", scenes.SCENES)
def test_axe_finds_nothing(name: str, theme: str, bench: Callable[..., StandIn], opened: Callable[..., Any]) -> None:
    one = bench(scenes.SCENES[name]())
    _filled(one)
    page = opened(one.address, color_scheme=theme)
    page.locator("#controls_words:not([data-code=waiting])").wait_for()
    until(lambda: one.state["controls"])
    if name == "running":
        one.read(scenes.readings(one.now()), reset=True)
    assert _violations(page) == []


@pytest.mark.parametrize("theme", THEMES)
def test_nor_where_something_is_wrong(theme: str, bench: Callable[..., StandIn], opened: Callable[..., Any]) -> None:
    one = bench(scenes.running())
    _filled(one)
    page = opened(one.address.partition("#")[0], color_scheme=theme)
    page.locator("#no_token").wait_for()
    assert _violations(page) == []
    page.keyboard.press("Escape")
    page.locator("#stop_said.bad").wait_for()
    assert _violations(page) == []
    page.locator("#stop_close").click()
    one.state["controls"] = "another"
    page = opened(one.address, color_scheme=theme)
    page.locator("#watching").wait_for()
    assert _violations(page) == []
    page.locator("#stop").click()
    page.locator("#stop_said.good").wait_for()
    assert _violations(page) == []
    page.locator("#stop_close").click()
    one.talking.clear()
    page.locator("#no_server").wait_for()
    page.locator("#numbers.old").wait_for()
    assert _violations(page) == []


@pytest.mark.parametrize("theme", THEMES)
def test_nor_in_the_list_of_runs(theme: str, bench: Callable[..., StandIn], opened: Callable[..., Any]) -> None:
    one = bench(scenes.bench())
    one.runs = scenes.runs()
    page = opened(one.address, color_scheme=theme)
    page.locator("#to_runs").click()
    page.locator("#runs_rows tr").first.wait_for()
    assert _violations(page) == []


@pytest.mark.parametrize("name", scenes.SCENES)
def test_every_control_is_reached_by_the_tabulator_and_seen_there(
    name: str, bench: Callable[..., StandIn], opened: Callable[..., Any]
) -> None:
    one = bench(scenes.SCENES[name]())
    _filled(one)
    page = opened(one.address)
    until(lambda: one.state["controls"])
    page.locator("#stop:enabled").wait_for()
    page.evaluate("new Promise((done) => setTimeout(done, 500))")
    shown = page.evaluate(
        """(wanted) => {
          window.all = [...document.querySelectorAll(wanted)].filter((one) => one.checkVisibility());
          const radios = all.filter((one) => one.type === "radio" && !one.checked);
          return all.filter((one) => !radios.includes(one)).map((one) => all.indexOf(one));
        }""",
        FOCUSABLE,
    )
    reached = set()
    for _ in range(len(shown) + 2):
        page.keyboard.press("Tab")
        place, ring = page.evaluate(
            """() => {
              const one = document.activeElement, drawn = one.type === "radio" ? one.nextElementSibling : one;
              return [all.indexOf(one), getComputedStyle(drawn).outlineWidth];
            }"""
        )
        if place >= 0:
            reached.add(place)
            assert ring == "4px"
    assert reached == set(shown)
