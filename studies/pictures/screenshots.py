"""Screenshots of a run's report and of a comparison, as docs/figures/*.png. Needs Chromium (Debian: chromium).

The run is the tutorial's, the recording its synthetic afferent. Use: python -m studies.pictures.screenshots [FOLDER]
"""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[2]
TUTORIAL = ROOT / "examples" / "tutorial"
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
WIDTH, PATIENCE_S = 1060, 120
HEIGHTS = {"run_report": 1800, "comparison": 1500}
_QUIET = ("--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--disable-background-networking")


def main(folder: Path) -> None:
    """Make both pages anew and take their pictures."""
    browser = next((found for name in BROWSERS if (found := shutil.which(name))), None)
    if browser is None:
        sys.exit(f"no browser, expected one of {', '.join(BROWSERS)}")
    with tempfile.TemporaryDirectory() as work:
        for name, page in _pages(Path(work)).items():
            _shoot(browser, page, folder / f"{name}.png", HEIGHTS[name])


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
