"""Line under the title of each page: the day, the runs and their bench, and the version."""

from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from importlib.metadata import version

from rig.data import Run
from rig.plan.finger_model import from_copy
from sim.contact.shapes import shape_size
from sim.errors import SimError

_MOST_NAMED = 3


def source_line(runs: Sequence[Run], instead: str = "") -> str:
    """Return the line; `instead` says what a page without a run is computed from."""
    now = datetime.now(UTC).timestamp()
    day = datetime.fromtimestamp(max((float(run.start["unix_s"]) for run in runs), default=now), UTC)
    named = [f"{run.folder.path.name}{' (virtual bench)' * bool(run.start.get('virtual'))}" for run in runs]
    more = [f"{len(named) - _MOST_NAMED} more"] if len(named) > _MOST_NAMED else []
    about = f"{'runs' if len(runs) > 1 else 'run'} {', '.join([*named[:_MOST_NAMED], *more])}" if runs else instead
    parts = [f"{day:%Y-%m-%d}", about, indentors_in_words(runs), f"indentation-rig {version('indentation-rig')}"]
    return " · ".join(filter(None, parts))


def indentors_in_words(runs: Iterable[Run]) -> str:
    """Return the indentors of runs with what was read of them, from the runs' own copies of files."""
    mounted = dict.fromkeys((event["indentor"], run.folder.path) for run in runs for event in run.stream("mount"))
    return shapes_in_words((name, from_copy(folder, name)) for name, folder in mounted)


def shapes_in_words(shapes: Iterable[tuple[str, str]]) -> str:
    """Return shapes by name, each with what was read of the second name: size, relief, side that is up, grays."""
    return ", ".join(dict.fromkeys(f"{name} ({size})" if (size := _size(read)) else name for name, read in shapes))


def _size(shape: str) -> str:
    try:
        return shape_size(shape)
    except SimError:
        return ""  # of a run of another version
