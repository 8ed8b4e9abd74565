"""Line under the title of each page: the day, the runs and their bench, and the version."""

from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.metadata import version

from rig.data import Run

_MOST_NAMED = 3


def source_line(runs: Sequence[Run], instead: str = "") -> str:
    """Return the line; `instead` says what a page without a run is computed from."""
    now = datetime.now(UTC).timestamp()
    day = datetime.fromtimestamp(max((float(run.start["unix_s"]) for run in runs), default=now), UTC)
    named = [f"{run.folder.path.name}{' (virtual bench)' * bool(run.start.get('virtual'))}" for run in runs]
    more = [f"{len(named) - _MOST_NAMED} more"] if len(named) > _MOST_NAMED else []
    about = f"{'runs' if len(runs) > 1 else 'run'} {', '.join([*named[:_MOST_NAMED], *more])}" if runs else instead
    return f"{day:%Y-%m-%d} · {about} · indentation-rig {version('indentation-rig')}"
