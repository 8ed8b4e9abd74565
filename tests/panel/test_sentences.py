"""The page's sentences are in sentences.txt; its tests hold the codes beside them.

`GOLDEN=write pytest tests/panel/test_sentences.py` writes the sentences anew.
"""

import ast
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.panel import scenes
from tests.panel.stand_in import StandIn
from tests.waiting import until

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
GOLDEN = HERE / "sentences.txt"
HOLDS_TEXT = {"to_have_text", "to_contain_text", "get_by_text", "get_by_role", "get_by_label", "filter"}
CHANGING = {r"\d\d:\d\d:\d\d": "hh:mm:ss", r"\d+ s ago": "N s ago", r"after \d+ ms": "after N ms"}
"""Text that differs between two runs of the test, and its replacement."""


@pytest.mark.parametrize("path", sorted(HERE.glob("test_*.py")), ids=lambda path: path.stem)
def test_tests_of_the_page_hold_no_sentence(path: Path) -> None:
    """Numbers with their units are compared; words of the page are not."""
    calls = [node for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(node, ast.Call)]
    found = [
        f"{path.name}:{node.lineno}: {text}"
        for node in calls
        if isinstance(node.func, ast.Attribute) and node.func.attr in HOLDS_TEXT
        for one in [*node.args, *(keyword.value for keyword in node.keywords)]
        for text in _texts(one)
        if re.search(r"[A-Za-z]{4}", text)
    ]
    assert found == []


def test_the_manual_names_what_the_page_has() -> None:
    """Buttons and words in italics are those of the page."""
    manual = (ROOT / "docs" / "panel.md").read_text(encoding="utf-8")
    page = (ROOT / "rig" / "panel" / "static" / "index.html").read_text(encoding="utf-8") + GOLDEN.read_text("utf-8")
    named = re.findall(r"(?<!\*)\*(\w[\w ]+\w)\*(?!\*)", manual)
    assert len(named) >= 3
    assert [name for name in named if name.lower() not in page.lower()] == []


def _texts(node: ast.AST) -> list[str]:
    """String literals that are compared, not those that name a key of a dictionary."""
    if isinstance(node, ast.Subscript):
        return []
    own = [node.value] if isinstance(node, ast.Constant) and isinstance(node.value, str) else []
    return own + [text for child in ast.iter_child_nodes(node) for text in _texts(child)]


def test_the_page_says_what_stands_in_the_file(bench: Callable[..., StandIn], opened: Callable[..., Any]) -> None:
    lines: set[str] = set()
    for scene in scenes.SCENES.values():
        lines |= _said(_page(bench(scene()), opened))
    one = bench(scenes.running())
    page = _page(one, opened)
    lines |= _after_stop(page, "confirmed")
    for status, code in ((409, "answered"), (403, "not_allowed"), (503, "not_confirmed")):
        one.answers["/stop"] = (status, {"ok": False, "problem": "PROBLEM"})
        lines |= _after_stop(page, code)
    one.talking.clear()
    page.locator("#what[data-code=lost]").wait_for()
    lines |= _said(page)
    page = opened(one.address.partition("#")[0])
    page.locator("#what[data-code=no_token]").wait_for()
    lines |= _said(page)
    found = "".join(f"{line}\n" for line in sorted(lines))
    if os.environ.get("GOLDEN") == "write":
        GOLDEN.write_text(found, encoding="utf-8")
    assert found == GOLDEN.read_text(encoding="utf-8")


def _page(one: StandIn, opened: Callable[..., Any]) -> Any:
    page = opened(one.address)
    until(lambda: one.state["controls"])
    age_s = one.state["newest"]["age_s"]
    code = "unread" if age_s is None else "old" if age_s > 1 else "live"
    page.locator(f"#read_at[data-code={code}]").wait_for()
    page.locator("#what:not([data-code=not_answered_yet])").wait_for()
    page.locator("#watching").wait_for(state="hidden")
    return page


def _after_stop(page: Any, code: str) -> set[str]:
    page.keyboard.press("Escape")
    page.locator(f"#stop_words[data-code={code}]").wait_for()
    lines = _said(page, "#stop_words")
    page.locator("#stop_close").click()
    return lines


def _said(page: Any, where: str = "") -> set[str]:
    """Element, code and sentence of all that is shown and has a code."""
    shown = page.locator(f"{where}[data-code]:visible").evaluate_all(
        "all => all.map((one) => `${one.id} ${one.dataset.code}: ${one.textContent}`)"
    )
    for pattern, word in CHANGING.items():
        shown = [re.sub(pattern, word, line) for line in shown]
    return set(shown)
