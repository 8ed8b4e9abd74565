"""Screenshots of a run's report, of a comparison and of the panel, as docs/figures/*.png.

The run is the tutorial's, the recording its synthetic afferent. Needs Chromium (Debian: chromium), and Playwright for
the panel (`make panel-test` installs it). Use: python -m studies.pictures.screenshots [FOLDER]
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

from studies.pictures.chromium import MISSING, chromium
from studies.pictures.panel_page import browser, panel

ROOT = Path(__file__).parents[2]
TUTORIAL = ROOT / "examples" / "tutorial"
WIDTH, PATIENCE_S = 1060, 120
HEIGHTS = {"run_report": 1800, "comparison": 1500}
COLOURS = 64
PRESS = (
    "document.getElementById('phase_words').textContent === 'hold'"
    " && document.getElementById('depth_words').textContent !== '–'"
)
LATER = "Number.parseInt(document.getElementById('done_words').textContent) >= 3"
DRAWN = (
    "!document.getElementById('place').hidden"
    " && !document.getElementById('press_words').textContent.includes('no prediction')"
)
_QUIET = ("--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--disable-background-networking")


def main(folder: Path) -> None:
    """Make both pages anew and take their pictures."""
    program = chromium()
    if program is None:
        sys.exit(MISSING)
    with tempfile.TemporaryDirectory() as work:
        os.environ["RIG_RUNTIME_DIR"] = str(Path(work) / "runtime")  # the panel shows no other run of this machine
        for name, page in _pages(Path(work)).items():
            _shoot(program, page, folder / f"{name}.png", HEIGHTS[name])
        _shoot_panel(folder / "panel.png", Path(work), (1280, 860))


def _pages(work: Path) -> dict[str, Path]:
    """The report of a run, and that of its comparison, in a folder to be thrown away."""
    recorded = f"step:1={TUTORIAL / 'synthetic_afferent.csv'}"
    _rig("dry-run", TUTORIAL / "first.py", "--out", work / "runs")
    (run,) = (work / "runs").glob("*-first-*")
    _rig("compare", run, "--recorded", recorded, "--out", work / "comparison.html")
    return {"run_report": run / "report.html", "comparison": work / "comparison.html"}


def _rig(*words: object) -> None:
    print("rig", words[0], "…", flush=True)
    subprocess.run([sys.executable, "-m", "rig", *map(str, words)], check=True, stdout=subprocess.DEVNULL)


def _shoot(program: str, page: Path, picture: Path, height: int) -> None:
    size = f"--window-size={WIDTH},{height}"
    command = [program, *_QUIET, size, f"--screenshot={picture}", page.resolve().as_uri()]
    subprocess.run(command, check=True, capture_output=True, timeout=PATIENCE_S)
    _reduce(picture)


def _shoot_panel(picture: Path, work: Path, size: tuple[int, int]) -> None:
    """In the hold of an indentation after the third, with what the model says of it."""
    words = ("dry-run", "steps", "--speed", "2", "--out", work)
    with panel(work) as (_, url), browser() as found:
        page = found.new_page(viewport={"width": size[0], "height": size[1]})
        page.set_default_timeout(0)
        page.goto(url)
        run = subprocess.Popen([sys.executable, "-m", "rig", *map(str, words)], stdout=subprocess.DEVNULL)
        try:
            page.wait_for_function(f"() => {LATER} && {PRESS} && {DRAWN} && !document.querySelector('#numbers.old')")
            page.screenshot(path=picture)
        finally:
            run.terminate()
            run.wait()
    _reduce(picture)


def _reduce(picture: Path) -> None:
    """Keep few colors: a third of the bytes, and it looks the same."""
    with Image.open(picture) as shot:
        shot.convert("P", palette=Image.Palette.ADAPTIVE, colors=COLOURS).save(picture, optimize=True)
    print(picture)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs" / "figures")
