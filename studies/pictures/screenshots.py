"""Screenshots of a run's report, of a comparison and of the panel, as docs/figures/*.png.

The run is the tutorial's, the recording its synthetic afferent. Needs Chromium (Debian: chromium), and Playwright for
the panel (`make panel-test` installs it). Use: python -m studies.pictures.screenshots [FOLDER]
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from studies.pictures.chromium import MISSING, chromium
from studies.pictures.panel_shot import shoot_panel

ROOT = Path(__file__).parents[2]
TUTORIAL = ROOT / "examples" / "tutorial"
WIDTH, PATIENCE_S = 1060, 120
HEIGHTS = {"run_report": 1800, "comparison": 1500}
_QUIET = ("--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--disable-background-networking")


def main(folder: Path) -> None:
    """Make both pages anew and take their pictures."""
    browser = chromium()
    if browser is None:
        sys.exit(MISSING)
    with tempfile.TemporaryDirectory() as work:
        os.environ["RIG_RUNTIME_DIR"] = str(Path(work) / "runtime")  # the panel shows no other run of this machine
        for name, page in _pages(Path(work)).items():
            _shoot(browser, page, folder / f"{name}.png", HEIGHTS[name])
        shoot_panel(folder / "panel.png", Path(work), (1280, 860))


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


def _shoot(browser: str, page: Path, picture: Path, height: int) -> None:
    size = f"--window-size={WIDTH},{height}"
    command = [browser, *_QUIET, size, f"--screenshot={picture}", page.resolve().as_uri()]
    subprocess.run(command, check=True, capture_output=True, timeout=PATIENCE_S)
    print(picture)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs" / "figures")
