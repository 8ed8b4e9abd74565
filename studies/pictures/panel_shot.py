"""A screenshot of the panel's page while a dry-run of the source's steps is under way."""

import subprocess
import sys
from io import BytesIO
from pathlib import Path

from PIL import Image

from studies.pictures.panel_page import browser, panel

COLOURS = 64  # a third of the bytes, and looks the same
PRESS = "document.getElementById('phase_words').textContent === 'hold'"
LATER = "Number.parseInt(document.getElementById('done_words').textContent) >= 3"
DRAWN = (
    "!document.getElementById('place').hidden"
    " && !document.getElementById('press_words').textContent.includes('no prediction')"
)


def shoot_panel(picture: Path, work: Path, size: tuple[int, int]) -> None:
    """In the hold of an indentation after the third, with what the model says of it."""
    words = ("dry-run", "steps", "--speed", "2", "--out", work)
    with panel(work) as (_, url), browser() as found:
        page = found.new_page(viewport={"width": size[0], "height": size[1]})
        page.set_default_timeout(0)
        page.goto(url)
        run = subprocess.Popen([sys.executable, "-m", "rig", *map(str, words)], stdout=subprocess.DEVNULL)
        try:
            page.wait_for_function(f"() => {LATER} && {PRESS} && {DRAWN} && !document.querySelector('#numbers.old')")
            shot = Image.open(BytesIO(page.screenshot()))
            shot.convert("P", palette=Image.Palette.ADAPTIVE, colors=COLOURS).save(picture, optimize=True)
        finally:
            run.terminate()
            run.wait()
    print(picture)
