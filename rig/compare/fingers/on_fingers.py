"""What the fingers of a design would give where a run pressed."""

from collections import deque
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rig.compare.errors import FingersError
from rig.compare.parameter_study.interpolation import interpolated, nodes_to_build
from rig.compare.parameter_study.workers import spread
from rig.compare.plausible import DesignFinger, PlausibleFingers
from rig.compare.stimuli import Stimulus
from rig.data import Run
from sim.config import FingertipConfig
from sim.contact.shapes import parse_shape
from sim.errors import ModelRangeError
from sim.finger.mesh import MeshError
from sim.finger.surface import SurfaceError
from sim.measures.measures import MEASURES, shown
from sim.measures.receptors import ReceptorError
from sim.models.cache import cached_arrays, content_key, simulator_code
from sim.models.fingertip import Fingertip
from sim.models.interpolation import Asked, make_node

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PressRow:
    """One indentor at a row of places, each to its own depth or force."""

    indentor: str
    kind: str  # doi_mm or force_gwt
    x_mm: tuple[float, ...]
    target: tuple[float, ...]


@dataclass(frozen=True)
class FingerWork:
    """All rows of presses on one finger: a piece of work."""

    name: str
    config_json: str
    receptor_x_mm: tuple[float, ...]
    receptor_depth_mm: float
    press_rows: tuple[PressRow, ...]
    exact: bool = True  # built in full; else interpolated between full builds

    @property
    def finger(self) -> Asked:
        """With its receptors."""
        return Asked.of(self.config_json, self.receptor_x_mm, self.receptor_depth_mm)

    @property
    def shapes(self) -> tuple[str, ...]:
        """By their names."""
        return tuple(row.indentor for row in self.press_rows)


def on_plausible_fingers(
    run: Run, pressed: Sequence[Stimulus], finger: Fingertip, plausible: PlausibleFingers, *, exact: bool = False
) -> list[Stimulus]:
    """The stimuli of a run with their measures on the whole design, pressed over this machine's processes.

    What was controlled stays: the force of a press to a force, the depth of one to a depth; on hardware the force
    that was recorded. Fingers that differ in the moduli of dermis and fat alone may be interpolated, unless `exact`.
    Kept in the cache. Raises FingersError.
    """
    if not pressed:
        return []
    virtual = bool(run.start["virtual"])
    press_rows = tuple(_press_row(stimulus, virtual) for stimulus in pressed)
    design = plausible.design(finger.config, finger.model.receptors.depth_mm)
    x_mm = tuple(pressed[0].receptor_mm.tolist())
    work = [_work(one, x_mm, press_rows) for one in design]
    if not exact:
        work = interpolated(work)
    key = content_key([simulator_code(), [asdict(one) for one in work]])
    try:
        found, _ = cached_arrays(key, lambda: _all_answers(work), kind="answers")
    except FingersError as error:
        fields = {**error.fields, "where": plausible.source, "problem": str(error)}
        raise FingersError("{where}: {problem}", code=error.code, **fields) from None
    between = not all(one.exact for one in work)
    said = [np.asarray(found[f"{n}"], dtype=float) for n in range(len(pressed))]
    return [replace(s, on_fingers=one, interpolated=between) for s, one in zip(pressed, said, strict=True)]


def _press_row(stimulus: Stimulus, virtual: bool) -> PressRow:
    kind = stimulus.kind if virtual else "force_gwt"
    target = stimulus.doi_mm if kind == "doi_mm" else stimulus.force_gwt
    return PressRow(stimulus.read_as, kind, tuple(stimulus.x_mm.tolist()), tuple(target.tolist()))


def _work(finger: DesignFinger, receptor_x_mm: tuple[float, ...], press_rows: tuple[PressRow, ...]) -> FingerWork:
    return FingerWork(
        finger.name, finger.config.model_dump_json(), receptor_x_mm, finger.receptor_depth_mm, press_rows
    )


def _all_answers(work: Sequence[FingerWork]) -> dict[str, NDArray[np.generic]]:
    """For each row by its number (fingers, 18, n, receptors)."""
    deque(spread(make_node, nodes_to_build(work)), maxlen=0)
    answers = list(spread(measures_on, work))
    return {f"{n}": np.stack(each) for n, each in enumerate(zip(*answers, strict=True))}


def measures_on(work: FingerWork) -> list[Array]:
    """For each row the measures (18, n, receptors) in the signs of `shown`. Raises FingersError."""
    config = FingertipConfig.model_validate_json(work.config_json)
    try:
        places = {"receptor_x_mm": work.receptor_x_mm, "receptor_depth_mm": work.receptor_depth_mm}
        finger = Fingertip.load(config, **places, exact=work.exact)  # type: ignore[arg-type]
        return [_measures(finger, row) for row in work.press_rows]
    except (ModelRangeError, MeshError, SurfaceError, ReceptorError) as error:
        raise FingersError(
            "on the finger with {finger}: {problem}", code="not_pressed", finger=work.name, problem=str(error)
        ) from None


def _measures(finger: Fingertip, row: PressRow) -> Array:
    shape = parse_shape(row.indentor)
    results = [
        finger.indent(shape, shape.lateral_mm(x), **{row.kind: target})  # type: ignore[arg-type]
        for x, target in zip(row.x_mm, row.target, strict=True)
    ]
    return np.array([[shown(name, result.receptor_measures[name]) for result in results] for name in MEASURES])
