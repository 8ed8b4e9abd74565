"""The page on the real server, and a run that was begun elsewhere."""

import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from studies.pictures.panel_page import panel
from tests.panel.coded import coded
from tests.program import EMPTY_FIGURES
from tests.waiting import until

expect = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed (make panel-test)").expect
Opened = Callable[..., Any]


def _rig(*words: object) -> "subprocess.Popen[str]":
    begin = [sys.executable, "-c", f"{EMPTY_FIGURES}from rig.cli import main; main()"]
    return subprocess.Popen(
        [*begin, *map(str, words)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, text=True
    )


def test_a_run_that_was_begun_in_a_terminal_is_shown_until_its_end(opened: Opened, tmp_path: Path) -> None:
    with panel(tmp_path) as (_, url):
        page = opened(url)
        expect(page.locator("#what")).to_have_attribute(*coded("nothing"))
        run = _rig("dry-run", "first_press", "--speed", "2", "--set", "presses=2", "--out", tmp_path)
        try:
            expect(page.locator("#read_at")).to_have_attribute(*coded("live"))
            expect(page.locator("#steps [aria-current=step]")).to_have_count(1)
            expect(page.locator("#left_words")).to_have_attribute(*coded("left"))
            shown = {page.locator("#force_gwt").text_content()}
            until(lambda: shown.add(page.locator("#force_gwt").text_content()) or len(shown) > 5)
            drawn = page.evaluate("document.querySelector('#force_time canvas').toDataURL()")
            until(lambda: page.evaluate("document.querySelector('#force_time canvas').toDataURL()") != drawn)
            expect(page.locator("#left_words")).to_have_attribute(*coded("done"))
            expect(page.locator("#done_words")).to_have_text(re.compile(r"^2\D+2\D"))
            expect(page.locator("#read_at")).to_have_attribute(*coded("old"))
            expect(page.locator("#section .indentor")).to_have_count(1)
            run.wait()  # for its report
        finally:
            run.terminate()
            run.wait()
        page.locator("#to_runs").click()
        expect(page.locator("#runs_rows tr")).to_have_count(1)
        with page.expect_popup() as report:
            page.locator("#runs_rows a").click()
        expect(report.value.locator("h1")).to_be_visible()
