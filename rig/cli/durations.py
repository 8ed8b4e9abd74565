"""Durations of earlier work by kind, stored beside the cache of models, for the estimates of later commands."""

import json
import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from statistics import median

from rig_shared.user_files import json_of, read_text

FILE = "durations.json"
MOST_KINDS, MOST_TIMES = 100, 5
_LONGEST_KIND = 200  # characters
_LONGEST_S = 1e9
LEAST_S = 0.3
"""Shorter work is not recorded unless its kind took longer before."""

Times = dict[str, list[float]]


def folder() -> Path:
    """Return the cache folder, as `sim` does, which a help does not import."""
    chosen = os.environ.get("RIG_CACHE_DIR")
    if chosen:
        return Path(chosen)
    from platformdirs import user_cache_path  # a help does not need it either

    return user_cache_path("indentation-rig")


def path() -> Path:
    """Return the file of durations."""
    return folder() / FILE


def expected_s(kind: str, size: float) -> float | None:
    """Return the expected duration of this kind and size of work (s), or None if none is recorded."""
    times = _read().get(kind)
    return None if times is None else median(times) * size


def took(kind: str, size: float, seconds: float) -> None:
    """Record a time; nothing happens where the folder cannot be written."""
    times = _read()
    if seconds < LEAST_S and kind not in times:
        return
    last = times.pop(kind, [])
    newest = {kind[:_LONGEST_KIND]: [*last, seconds / max(size, 1e-9)][-MOST_TIMES:], **times}
    _write(dict(list(newest.items())[:MOST_KINDS]))


def _read() -> Times:
    """Return the times by kind, the latest kind first; nothing from a missing or damaged file."""
    try:
        content = json_of(read_text(path()))
    except (OSError, ValueError, RecursionError):
        return {}
    if not isinstance(content, dict):
        return {}
    return {kind: times for kind, times in content.items() if _is_sound(times)}


def _is_sound(times: object) -> bool:
    if not isinstance(times, list) or not 0 < len(times) <= MOST_TIMES:
        return False
    return all(isinstance(one, int | float) and 0 <= one <= _LONGEST_S for one in times)


def _write(times: Mapping[str, list[float]]) -> None:
    to = path()
    partial = to.with_suffix(f".{os.getpid()}")
    with suppress(OSError):
        to.parent.mkdir(parents=True, exist_ok=True)
        try:
            partial.unlink(missing_ok=True)
            with partial.open("x", encoding="utf-8") as file:  # writes through no link
                file.write(json.dumps(times))
            partial.replace(to)
        finally:
            partial.unlink(missing_ok=True)
