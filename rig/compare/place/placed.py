"""From runs and their recordings to where the receptor is: the grid's stimuli, and the fit of each afferent."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from rig.compare.answers.judging import afferents
from rig.compare.answers.likeliest import Form
from rig.compare.comparison import compare
from rig.compare.place.place_fit import whereabouts
from rig.compare.place.place_grid import PlaceRange, Range, finger_with_grid, place_range
from rig.compare.place.whereabouts import Whereabouts
from rig.compare.recordings.recorded import Recording
from rig.compare.stimuli import stimuli
from rig.data import Run
from rig.plan.config import load_config
from sim.config import FingertipConfig
from sim.models.fingertip import Fingertip


class Sought(NamedTuple):
    """Ranges in mm that are asked for; None: the usual depths, and no offset."""

    x_mm: Range
    depth_mm: Range | None = None
    offset_mm: Range | None = None


def sought_in(runs: Sequence[Run], sought: Sought) -> PlaceRange:
    """The range of the fit, which must lie in one layer of every run's finger. Raises ComparisonError."""
    configs = [_finger(run) for run in runs]
    where = place_range(*sought, configs[0])
    for config in configs[1:]:
        place_range(where.x_mm, where.depth_mm, sought.offset_mm, config)
    return where


def places(
    runs: Sequence[Run], recordings: Mapping[str, Recording], where: PlaceRange, form: Form, *, normalise: bool
) -> list[Whereabouts]:
    """One for each afferent, as of the answers; none of one with too few positions covered."""
    fingers: dict[str, Fingertip] = {}
    for config in map(_finger, runs):
        name = config.model_dump_json()
        fingers[name] = fingers.get(name) or finger_with_grid(config, where)
    on_grid = [one for run in runs for one in stimuli(run, fingers[_finger(run).model_dump_json()])]
    laid = afferents(compare(on_grid, recordings, normalise=normalise))
    return [found for overlays in laid if (found := whereabouts(overlays, where, form)) is not None]


def _finger(run: Run) -> FingertipConfig:
    return load_config(run.folder.path / "config.toml").finger
