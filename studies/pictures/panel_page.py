"""The panel in a process of its own, and a browser for its page."""

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from studies.pictures.chromium import FLAGS, chromium


@contextmanager
def panel(out: Path, *options: str) -> Iterator[tuple[int, str]]:
    """`rig panel`: its process, and the address it prints."""
    words = [sys.executable, "-m", "rig", "panel", "--json", "--no-browser", "--out", str(out), *options]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            yield process.pid, json.loads(process.stdout.readline())["url"]
        finally:
            process.terminate()


@contextmanager
def browser() -> Iterator[Any]:
    """Chromium, by Playwright."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        found = playwright.chromium.launch(executable_path=chromium(), args=list(FLAGS))
        yield found
        found.close()
