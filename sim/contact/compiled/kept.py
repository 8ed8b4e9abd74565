"""Where this project keeps what took long to make."""

import os
from pathlib import Path

from platformdirs import user_cache_path


def cache_dir() -> Path:
    """Folder of all that is kept: RIG_CACHE_DIR, or the user's cache folder."""
    chosen = os.environ.get("RIG_CACHE_DIR")
    return Path(chosen) if chosen else user_cache_path("indentation-rig")
