"""What the panel's page sends while a direction is held and for STOP, its scripts run by Node.js, without a browser.

How a browser delivers keys, clicks and touches to them: tests/panel.
"""

import json
import shutil
import subprocess
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

import rig.panel

NODE = shutil.which("node")
pytestmark = pytest.mark.skipif(NODE is None, reason="Node.js is not installed")

STATIC = Path(rig.panel.__file__).with_name("static")
PAGE = Path(__file__).with_name("page_scripts.mjs")
Steps = Sequence[tuple[str, object]]
Walk = Callable[..., dict[str, Any]]
HOLD: Steps = [("key down", "d"), ("wait", 350)]


@pytest.fixture
def walk(tmp_path: Path) -> Walk:
    """What the page sent and showed after each step, a scene for each name."""
    (tmp_path / "package.json").write_text('{"type": "module"}', encoding="utf-8")
    for path in STATIC.glob("*.js"):
        text = path.read_text("utf-8").replace('"/static/', '"./')
        (tmp_path / path.name).write_text(text, encoding="utf-8")

    def walked(scenes: dict[str, Steps]) -> dict[str, Any]:
        words = [str(NODE), str(PAGE), str(tmp_path), json.dumps(scenes)]
        return dict(json.loads(subprocess.run(words, check=True, capture_output=True, text=True).stdout))

    return walked


def _sent(scene: dict[str, Any], path: str) -> list[dict[str, Any]]:
    return [one for one in scene["sent"] if one["path"] == path]


def _let_go(name: str, scene: dict[str, Any]) -> None:
    """Released once, and nothing held after it."""
    paths = [one["path"] for one in scene["sent"] if one["path"] in ("/hold", "/release")]
    assert paths[-1] == "/release", name
    assert paths.count("/release") == 1, name
    assert _sent(scene, "/release")[0]["body"] == {"press": _sent(scene, "/hold")[-1]["body"]["press"]}, name
    assert not scene["shown"][-1]["moving"], name


def test_a_direction_is_sent_ten_times_a_second_only_while_its_button_or_key_is_held(walk: Walk) -> None:
    scenes: dict[str, Steps] = {
        "key": [*HOLD, ("key up", "d"), ("wait", 1000)],
        "mouse": [("mouse down", "d"), ("wait", 350), ("mouse up", "d"), ("wait", 1000)],
    }
    for name, scene in walk(scenes).items():
        held = _sent(scene, "/hold")
        assert [one["at_ms"] for one in held] == [0, 100, 200, 300], name
        assert {(one["body"]["axis"], one["body"]["sign"], one["body"]["speed_mm_s"]) for one in held} == {
            ("x", 1, 1)
        }
        assert _sent(scene, "/release")[0]["at_ms"] == 350, name
        _let_go(name, scene)


DOUBTS: dict[str, tuple[Steps, str]] = {
    "another direction": ([("key down", "w")], "two_buttons"),
    "any letter": ([("key down", "q")], "two_buttons"),
    "Cmd": ([("key down", "Meta")], "two_buttons"),
    "STOP": ([("key down", "Escape")], "two_buttons"),
    "the mouse on another direction": ([("mouse down", "w")], "two_buttons"),
    "the mouse on its own direction": ([("mouse down", "d")], "two_buttons"),
    "a click elsewhere": ([("mouse down", "home")], "two_buttons"),
    "another window": ([("window", "blur")], "another_window"),
    "the page is left": ([("window", "pagehide")], "page_left"),
    "another tab": ([("hidden", None)], "tab_hidden"),
    "a page that hangs": ([("hang", 1000), ("wait", 1)], "page_too_slow"),
    "a refusal": ([("status", 409), ("wait", 100)], "refused"),
}


def test_a_second_key_a_click_elsewhere_another_window_or_a_stalled_page_lets_go(walk: Walk) -> None:
    after: Steps = [("status", 200), ("wait", 1000)]
    found = walk({name: [*HOLD, *steps, *after] for name, (steps, _) in DOUBTS.items()})
    finger: Steps = [("mouse down", "d"), ("wait", 350), ("mouse down", "d"), *after]
    _let_go("two fingers", walk({"two fingers": finger})["two fingers"])
    for name, (_, code) in DOUBTS.items():
        assert found[name]["shown"][1] == {"jog": "moving", "moving": True, "stop": None, "how": None}, name
        assert found[name]["shown"][-1]["jog"] == code, name
        assert {one["body"]["axis"] for one in _sent(found[name], "/hold")} == {"x"}, name
        _let_go(name, found[name])


def test_a_hold_that_is_not_answered_is_not_followed_by_another(walk: Walk) -> None:
    """What waited in a queue would move the stage after the release."""
    (scene,) = walk({"silent": [("silent", True), *HOLD, ("key up", "d")]}).values()
    assert [one["path"] for one in scene["sent"]] == ["/hold", "/release"]


STOPS: dict[str, Steps] = {"button": [("mouse down", "stop")], "key": [("key down", "Escape")]}


def test_stop_is_sent_first_and_repeated_until_it_is_answered(walk: Walk) -> None:
    """By the page at once and by its worker; beside a held direction too."""
    after: Steps = [("wait", 2000), ("silent", False), ("wait", 300), ("wait", 1000)]
    scenes: dict[str, Steps] = {
        f"{name}, {held}": [*(HOLD if held else []), ("silent", True), *steps, *after]
        for name, steps in STOPS.items()
        for held in (False, True)
    }
    for name, scene in walk(scenes).items():
        stops = _sent(scene, "/stop")
        begun_ms = stops[0]["at_ms"]
        at_the_press = [one["path"] for one in scene["sent"] if one["at_ms"] == begun_ms]
        assert at_the_press == ["/stop", "/stop", "/release"][: 3 if "True" in name else 2], name
        assert [one["by"] for one in stops[:2]] == ["page", "worker"], name
        again_ms = [one["at_ms"] for one in stops[1:]]
        assert {later - one for one, later in pairwise(again_ms)} == {300}, name
        assert again_ms[-1] - begun_ms == 2100, "not after its answer"
        assert scene["shown"][-1]["stop"] == "confirmed", name
        assert scene["shown"][-1]["how"] == "good", name


def test_the_page_shows_at_once_that_a_stop_is_not_answered(walk: Walk) -> None:
    scenes = {name: [("silent", True), *steps, ("wait", 299), ("wait", 1)] for name, steps in STOPS.items()}
    refused = {name: [("status", 503), *steps, ("wait", 350)] for name, steps in STOPS.items()}
    for name, scene in walk(scenes).items():
        *_, sent, loud = ((one["stop"], one["how"]) for one in scene["shown"])
        assert (sent, loud) == (("sent", "busy"), ("not_confirmed", "bad")), name
    for name, scene in walk(refused).items():
        assert (scene["shown"][-1]["stop"], scene["shown"][-1]["how"]) == ("not_confirmed", "bad"), name
