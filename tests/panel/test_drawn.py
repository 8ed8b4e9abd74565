"""What is drawn: predictions by the press they are of, a minute of readings and no more, profiles with a body."""

from collections.abc import Callable
from typing import Any

import pytest

from tests.panel import scenes
from tests.panel.stand_in import StandIn

pytest.importorskip("playwright.sync_api", reason="Playwright is not installed (make panel-test)")

COLUMNS = ["unix_s", "t_s", "force_gwt", "doi_mm", "index", "purpose"]
BUFFER = "async ([steps]) => { const { Buffer } = await import('/static/buffer.js'); const one = new Buffer();"


@pytest.fixture
def page(bench: Callable[..., StandIn], opened: Callable[..., Any]) -> Any:
    return opened(bench(scenes.bench()).address)


def _buffer(page: Any, steps: list[tuple[str, dict[str, Any]]]) -> dict[str, Any]:
    code = BUFFER + "for (const [name, data] of steps) one[name](data); return {...one, predicted: one.predicted}; }"
    return page.evaluate(code, [steps])


def _rows(*rows: tuple[float, float, float | None, int | None], run: str = "a") -> tuple[str, dict[str, Any]]:
    return "take", {"run": run, "columns": COLUMNS, "rows": [[0.0, *row, "data"] for row in rows]}


def _curve(index: int, slope: float, run: str = "a") -> tuple[str, dict[str, Any]]:
    doi_mm = [0.0, 0.5, 1.0]
    return "prediction", {"run": run, "index": index, "doi_mm": doi_mm, "force_gwt": [slope * d for d in doi_mm]}


def test_a_reading_is_laid_beside_the_curve_of_its_own_press(page: Any) -> None:
    one = _buffer(
        page, [_curve(0, 2), _rows((1, 0.3, 0.25, 0), (2, 0.4, None, 0)), _rows((3, 1.0, 0.75, 1)), _curve(1, 4)]
    )
    assert one["time"][3] == [0.5, None, 3.0]
    assert one["predicted"] == [[0.0, 0.5, 1.0], [0.0, 2.0, 4.0]]
    assert one["pressed"] == [[0.75], [1.0]]


def test_a_reading_outside_a_press_belongs_to_none(page: Any) -> None:
    """Its index is −1 in the journal."""
    one = _buffer(page, [_rows((1, 0.3, 0.25, -1), (2, 0.3, 0.25, None))])
    assert (one["press"], one["pressed"], one["time"][4]) == (None, [[], []], [None, None])


def test_a_curve_of_another_run_is_not_this_ones(page: Any) -> None:
    one = _buffer(page, [_curve(0, 2, run="b"), _rows((1, 0.3, 0.25, 0))])
    assert (one["time"][3], one["predicted"]) == ([None], [[], []])


def test_deeper_than_the_curve_the_model_says_nothing(page: Any) -> None:
    assert _buffer(page, [_curve(0, 2), _rows((1, 0.3, 1.01, 0), (2, 0.3, -0.01, 0))])["time"][3] == [None, None]


def test_a_minute_is_kept_and_a_clock_that_begins_anew_begins_anew(page: Any) -> None:
    one = _buffer(page, [_rows(*((float(t), 0.0, None, None) for t in range(100)))])
    assert one["time"][0] == [float(t) for t in range(39, 100)]
    one = _buffer(page, [_rows((50.0, 0.0, None, None)), _rows((1.0, 0.0, None, None))])
    assert one["time"][0] == [1.0]
    many = [(n / 1000, 0.0, 0.1, 0) for n in range(7000)]
    one = _buffer(page, [_rows(*many)])
    assert {len(column) for column in [*one["time"], *one["pressed"]]} == {6000}


def test_a_scale_stays_until_it_is_too_small_or_four_times_too_large(page: Any) -> None:
    top = "async ([before, values]) => (await import('/static/traces.js')).top(before, values)"
    said = [
        page.evaluate(top, [before, [value]]) for before, value in ((1, 0.8), (1, 0.9), (10, 2.6), (10, 2.0), (5, 0))
    ]
    assert said == [1, 1.5, 10, 3, 5]


def test_a_profile_is_drawn_with_a_body_and_a_narrow_contact_is_seen(
    bench: Callable[..., StandIn], opened: Callable[..., Any]
) -> None:
    one = bench(scenes.running())
    step = scenes.section() | {"indentor": [[-5, 0], [0, 0], [0.3, 0.5], [5, 0.5]], "contact": [[0.01, 0.02]]}
    one.say("section", step, keep=True)
    page = opened(one.address)
    path = page.locator("#section .profile").get_attribute("d")
    assert path.startswith("M-5 0L0 0L0.3 0.5L5 0.5L5 22.5L-5 22.5Z")
    assert page.locator("#section .contact").get_attribute("d").count("L") == 1
