"""Where Chromium is and how it is begun. python -m studies.pictures.chromium: its path, or how to get it."""

import os
import shutil
import sys

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
FLAGS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
)
MISSING = "no Chromium: apt install chromium (Debian), or CHROMIUM=PATH"


def chromium() -> str | None:
    """What CHROMIUM names, or the first one on the path."""
    wanted = os.environ.get("CHROMIUM")
    return next((found for name in ([wanted] if wanted else BROWSERS) if (found := shutil.which(name))), None)


if __name__ == "__main__":
    print(chromium() or sys.exit(MISSING))
