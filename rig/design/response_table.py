"""Table of receptor responses: every candidate under every press, on every finger of a design.

Strains are solved once for each finger and stored. Receptors lie on a grid of x and depth below the epidermis, and
locations between its nodes are interpolated by cubic splines.
"""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from functools import cached_property, lru_cache
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from rig.compare.plausible_fingers import PlausibleFingers
from rig.compare.stimuli import CONTROLS, controls
from rig.design.exceptions import DesignError
from rig.design.presses import PossiblePress
from rig.plan.finger_model import Predictions
from rig.records import Prediction, Target
from rig.study.parallel import spread
from sim.config import FingertipConfig
from sim.contact.shapes import contents, parse_shape
from sim.errors import ModelRangeError
from sim.finger.mesh import MeshError
from sim.finger.surface import SurfaceError
from sim.measures.measures import MEASURES, shown
from sim.measures.receptors import ReceptorError
from sim.models.cache import cached_arrays, content_key, simulator_code
from sim.models.fingertip import Fingertip

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
T = TypeVar("T")

CANDIDATES = (*MEASURES, *CONTROLS)
"""Names of all candidates: the measures, and the controls of a comparison."""

X_STEP_MM, DEPTH_STEP_MM = 0.25, 0.2
"""Maximum spacing of the nodes (mm)."""


class Counted(Protocol):
    """Function that yields the results of tasks and shows how many are done."""

    def __call__(self, answers: Iterable[T], total: int, what: str, /) -> Iterator[T]:
        """Yield the results."""


ABOUT = ("contact_mm", "force_gwt", "doi_mm", "area_mm2", "peak_mpa")


@dataclass(frozen=True, eq=False)
class ResponseTable:
    """Values of the candidates.

    `values` (fingers, presses, candidates, nodes), x varying fastest over nodes; measures have the signs of `shown`.
    `about` (presses, 5) are contact height above the apex (mm), force (gwt), depth (mm), contact area (mm²) and peak
    pressure, as in `Prediction`, on the configured finger. Presses that no model solves are NaN.
    """

    presses: tuple[PossiblePress, ...]
    values: Floats
    x_mm: Array
    below_mm: Array
    about: Array

    @property
    def free(self) -> int:
        """Number of free parameters of the finger."""
        return round(np.log(len(self.values)) / np.log(3))

    @property
    def doi_mm(self) -> Array:
        """Depths (presses,) on the configured finger (mm)."""
        return self.about[:, ABOUT.index("doi_mm")]

    @cached_property
    def predictions(self) -> Predictions:
        """Predictions of the presses, for the planner, which adds to them."""
        found = {}
        for press, (contact, force, doi, area, peak) in zip(self.presses, self.about.tolist(), strict=True):
            asked = press.shape, press.x_mm, Target(press.kind, press.target)
            if np.isfinite(force):
                found[asked] = Prediction(*asked, contact, force, doi, area, peak)
        return found  # type: ignore[return-value]

    def only(self, chosen: Sequence[int]) -> "ResponseTable":
        """Return the table of some of the presses, by their numbers."""
        presses = tuple(self.presses[k] for k in chosen)
        return replace(self, presses=presses, values=self.values[:, chosen], about=self.about[chosen])


@dataclass(frozen=True)
class _Task:
    """Presses on one finger."""

    config_json: str
    x_mm: tuple[float, ...]
    depth_mm: tuple[float, ...]
    presses: tuple[PossiblePress, ...]


def response_table(
    config: FingertipConfig,
    presses: Sequence[PossiblePress],
    x_mm: Array,
    below_mm: Array,
    plausible: PlausibleFingers | None,
    count: Counted,
) -> ResponseTable:
    """Return the table for nodes in x and below the epidermis (mm), from the cache or computed in parallel processes.

    Raises DesignError if a finger cannot be built, or has no such receptor.
    """
    configured = _task(config, presses, x_mm, below_mm)
    fingers = [config] if plausible is None else [one.config for one in plausible.design(config, np.nan)]
    tasks = [_task(one, presses, x_mm, below_mm) for one in fingers]
    all_tasks = list(dict.fromkeys([configured, *tasks]))
    shapes = contents(dict.fromkeys(press.shape for press in presses))
    key = content_key(["design", 1, simulator_code(), [asdict(one) for one in all_tasks], shapes])

    def solved() -> dict[str, NDArray[np.generic]]:
        for _ in count(spread(_prepared, all_tasks), len(all_tasks), "finger models"):
            pass
        parts = [part for task in all_tasks for part in _parts(task)]
        found = list(count(spread(_solved, parts), len(parts), "sets of presses"))
        each = len(parts) // len(all_tasks)
        rows = [np.concatenate(found[k : k + each]) for k in range(0, len(found), each)]
        by_task = dict(zip(all_tasks, rows, strict=True))
        values = np.stack([by_task[task][:, : len(CANDIDATES)] for task in tasks])
        return {"values": values, "about": by_task[configured][:, len(CANDIDATES) :, 0]}

    found, _ = cached_arrays(key, solved, kind="answers")
    values, about = np.asarray(found["values"], dtype=np.float32), np.asarray(found["about"], dtype=float)
    return ResponseTable(tuple(presses), values, x_mm, below_mm, about)


def finger_with_nodes(config: FingertipConfig, x_mm: Array, below_mm: Array) -> Fingertip:
    """Return the configured finger with the receptors of a table, which reads their strains instead of solving again.

    Raises DesignError.
    """
    task = _task(config, (), x_mm, below_mm)
    with _finger_problems():
        return _finger(task.config_json, task.x_mm, task.depth_mm)


def _task(config: FingertipConfig, presses: Sequence[PossiblePress], x_mm: Array, below_mm: Array) -> _Task:
    depth = (config.tissue.epidermis_mm + below_mm).round(6)
    return _Task(config.model_dump_json(), tuple(x_mm.round(6).tolist()), tuple(depth.tolist()), tuple(presses))


_IN_A_PART = 21


def _parts(task: _Task) -> list[_Task]:
    """Return the task in parts, so that progress is visible."""
    each = [task.presses[k : k + _IN_A_PART] for k in range(0, len(task.presses), _IN_A_PART)]
    return [_Task(task.config_json, task.x_mm, task.depth_mm, presses) for presses in each]


def _loaded(task: _Task) -> Fingertip:
    return _finger(task.config_json, task.x_mm, task.depth_mm)


@lru_cache(maxsize=1)
def _finger(config_json: str, x_mm: tuple[float, ...], depth_mm: tuple[float, ...]) -> Fingertip:
    """Return a finger, which all parts in a process share: each load reads the strains of every receptor."""
    config = FingertipConfig.model_validate_json(config_json)
    return Fingertip.load(config, receptor_x_mm=x_mm, receptor_depth_mm=depth_mm)


def _prepared(task: _Task) -> bool:
    """Build the models of a finger, which the parts then read from the cache."""
    with _finger_problems():
        finger = _loaded(task)
        for shape in dict.fromkeys(press.shape for press in task.presses):
            finger.model_for(parse_shape(shape).axes)
    return True


@contextmanager
def _finger_problems() -> Iterator[None]:
    try:
        yield
    except (ModelRangeError, MeshError, SurfaceError, ReceptorError) as error:
        raise DesignError(f"finger: {error}", "no_finger") from None


def _solved(task: _Task) -> Floats:
    """Return (presses, candidates + 5, nodes): the candidates, then what `about` has."""
    finger = _loaded(task)
    nodes = len(task.x_mm) * len(task.depth_mm)
    found = np.full((len(task.presses), len(CANDIDATES) + len(ABOUT), nodes), np.nan, dtype=np.float32)
    for row, press in zip(found, task.presses, strict=True):
        shape = parse_shape(press.shape)
        try:
            result = finger.indent(shape, shape.lateral_mm(press.x_mm), **{press.kind: press.target})  # type: ignore[arg-type]
        except ModelRangeError:
            continue
        if not result.state.converged:
            continue
        measures = result.receptor_measures
        about = (
            result.touch_height_mm - finger.apex_height_mm,
            result.force_gwt,
            result.doi_mm,
            result.contact_area_mm2,
            result.peak_pressure_mpa,
        )
        row[: len(MEASURES)] = [shown(name, measures[name]) for name in MEASURES]
        row[len(MEASURES) : len(CANDIDATES)] = controls(result)
        row[len(CANDIDATES) :] = np.array(about)[:, None]
    return found
