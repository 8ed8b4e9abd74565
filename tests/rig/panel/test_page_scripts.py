"""What the panel's page sends for a step and for STOP, its scripts run by Node.js, without a browser.

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


KEYS: Steps = [("key down", "d"), *[("key repeats", "d")] * 40]


def test_a_click_or_a_key_is_one_step_of_the_chosen_size(walk: Walk) -> None:
    """The repeats of a held key do nothing, and a size has a key, too."""
    scenes: dict[str, Steps] = {
        "key": [*KEYS, ("wait", 1000)],
        "mouse": [("click", "d"), ("wait", 1000)],
        "another size": [("key down", "5"), ("key down", "d")],
    }
    for name, scene in walk(scenes).items():
        (step,) = _sent(scene, "/step")
        assert step["body"].pop("unix_s") > 1e9, name
        by_mm = 1.0 if name == "another size" else 0.1
        assert step["body"] == {"axis": "x", "sign": 1, "by_mm": by_mm}, name
        assert [one["path"] for one in scene["sent"]] == ["/step"], name


def test_a_direction_that_is_disabled_or_not_shown_sends_nothing(walk: Walk) -> None:
    for scene in walk({"busy": [("disable", "d"), *KEYS], "runs": [("runs shown", None), *KEYS]}).values():
        assert scene["sent"] == []


def test_a_step_that_is_refused_is_shown(walk: Walk) -> None:
    (scene,) = walk({"refused": [("status", 409), ("click", "d"), ("wait", 1)]}).values()
    assert scene["shown"][-1]["said"] == "refused"


STOPS: dict[str, Steps] = {"button": [("mouse down", "stop")], "key": [("key down", "Escape")]}


def test_stop_is_sent_first_and_repeated_until_it_is_answered(walk: Walk) -> None:
    """By the page at once and by its worker; beside a held key too."""
    after: Steps = [("wait", 2000), ("silent", False), ("wait", 300), ("wait", 1000)]
    scenes: dict[str, Steps] = {
        f"{name}, {held}": [*(KEYS if held else []), ("silent", True), *steps, *after]
        for name, steps in STOPS.items()
        for held in (False, True)
    }
    for name, scene in walk(scenes).items():
        stops = _sent(scene, "/stop")
        begun_ms = stops[0]["at_ms"]
        at_the_press = [one["path"] for one in scene["sent"] if one["at_ms"] == begun_ms]
        assert at_the_press[-2:] == ["/stop", "/stop"], name
        assert [one["by"] for one in stops[:2]] == ["page", "worker"], name
        assert [one["port"] for one in stops[:4]] == ["stop", "stop", "page", "stop"], name
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
