"""Section of the finger and the indentor for the page, computed in a thread: the page draws it."""

import asyncio
import math
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from rig.clock import Clock
from rig.errors import BadInputError
from rig.panel.stream import Outlet
from rig.plan.config import load_config
from rig.plan.finger_model import from_copy
from rig_shared.errors import code_of
from sim.config import FingertipConfig
from sim.contact.indentor import Indentor
from sim.contact.patch import X, Z
from sim.contact.shapes import ShapeError, parse_shape
from sim.errors import ModelRangeError
from sim.finger.mesh import nodes_on_rays, order_of
from sim.finger.surface import FingertipSurface
from sim.models.fingertip import Fingertip
from sim.models.result import IndentationResult


@dataclass(frozen=True)
class PressSummary:
    """Press of a run: index among those of its purpose, position and target."""

    index: int
    purpose: str
    x_mm: float
    target: str  # doi_mm or force_gwt
    value: float


@dataclass(frozen=True)
class Job:
    """Inputs of a section: configuration, run folder with copies of the shape files, indentor and press."""

    config: Path
    folder: Path | None = None
    indentor: str | None = None
    along_mm: float = 0.0  # from the receptor plane
    press: PressSummary | None = None


Section = dict[str, Any]
_POLL_S = 0.05


class Sections:
    """Computes the latest requested section in a thread; superseded requests are dropped."""

    def __init__(self, request: Callable[[], Job | None], outlet: Outlet, clock: Clock) -> None:
        self._request, self._outlet, self._clock = request, outlet, clock
        self._published: Job | None = None
        self._over = threading.Event()

    async def follow(self) -> None:
        """Compute until cancelled; the solve in progress then ends after its present depth."""
        try:
            while True:
                await self.look()
                await asyncio.sleep(_POLL_S)
        finally:
            self._over.set()

    async def look(self) -> None:
        """Publish the next part: finger and indentor first, since solving takes longer."""
        job = self._request()
        if job is None or job == self._published:
            return
        still = replace(job, press=None)
        if self._published is None or replace(self._published, press=None) != still:
            job = still
        section = await asyncio.to_thread(section_of, job, lambda: self._over.is_set() or self._request() != job)
        self._published = job
        about = {
            "unix_s": self._clock.unix_s(),
            "run": None if job.folder is None else job.folder.name,
            "index": None if job.press is None else job.press.index,
            "purpose": None if job.press is None else job.press.purpose,
            "shape": job.indentor,
        }
        self._outlet.publish("section", {**about, "skin": [], "depths": [], **section})


Array = NDArray[np.float64]
Line = list[list[float]]

HIGHEST_MM = 2.0
"""Height above the lowest point (mm) up to which an indentor is drawn."""
_REACH_MM, _STEP_MM = 8.0, 0.02
_ANGLES = 181
_DIGITS = 4


def finger_outlines(
    config: FingertipConfig, surface: FingertipSurface, z_mm: float, apex_mm: float
) -> dict[str, Line | list[Line]]:
    """Return skin, layers, bone and nail of the section at z; heights from the nominal apex at `apex_mm`."""
    phi = np.linspace(-math.pi, math.pi, _ANGLES)
    nodes, layer = nodes_on_rays(config, surface, phi, np.array([z_mm]))
    changes = np.flatnonzero(np.diff(layer)) + 1
    ends = order_of(config.mesh) * np.append(changes, len(layer))
    rings = [points(nodes[0, :, end, 0], nodes[0, :, end, 1] - apex_mm) for end in ends[:3]]
    skin = points(nodes[0, :, 0, 0], nodes[0, :, 0, 1] - apex_mm)
    return {"skin": skin, "layers": rings[:2], "bone": rings[2], "nail": _nail(config, surface, z_mm, apex_mm)}


def _nail(config: FingertipConfig, surface: FingertipSurface, z_mm: float, apex_mm: float) -> Line:
    """Return the fixed part of the skin; nothing if the section has no nail."""
    if z_mm < config.tissue.nail_from_z_mm or config.tissue.nail_arc_deg <= 0:
        return []
    half = math.radians(0.5 * config.tissue.nail_arc_deg)
    x, y = surface.section(np.linspace(-0.5 * math.pi - half, -0.5 * math.pi + half, _ANGLES), z_mm)
    return points(x, y - apex_mm)


def indentor_outline(indentor: Indentor) -> Line:
    """Return the outline of the indentor through its reference point, across the finger; its lowest point is at 0."""
    s = np.arange(-_REACH_MM, _REACH_MM + 0.5 * _STEP_MM, _STEP_MM)
    offset = {X: s, Z: np.zeros_like(s)}
    height = indentor.evaluate(np.stack([offset[axis] for axis in indentor.axes])).height_mm
    height = np.minimum(height - min(float(height.min()), 0.0), HIGHEST_MM)
    low = np.flatnonzero(height < HIGHEST_MM)
    if not len(low):
        return []
    cut = slice(max(low[0] - 1, 0), low[-1] + 2)
    s, height = s[cut], height[cut]
    bent = np.ones(len(s), dtype=bool)
    bent[1:-1] = np.abs(np.diff(height, 2)) > 1e-9
    return points(s[bent], height[bent])


def points(x: Array, z: Array) -> Line:
    """Return points in the format of the page."""
    return np.round(np.stack([x, z], axis=1), _DIGITS).tolist()


DEPTHS = 8
"""Number of depths up to the target of a press."""


def depths_of(
    finger: Fingertip, shape: Indentor, press: PressSummary, over: Callable[[], bool] = lambda: False
) -> list[dict[str, Any]]:
    """Return depth, force, contact and skin of a predicted press up to its target. Raises ModelRangeError.

    over: whether the rest is no longer wanted.
    """
    x_mm, finger = shape.lateral_mm(press.x_mm), finger.keeping_ways()
    last = finger.indent(shape, x_mm, **{press.target: press.value})  # type: ignore[arg-type]
    found = []
    for n in range(1, DEPTHS):
        if over():
            break
        found.append(finger.indent(shape, x_mm, doi_mm=float(last.doi_mm * n / DEPTHS)))
    return [_at_depth(one, finger.apex_height_mm) for one in [*found, last] if one.state.converged]


def _at_depth(found: IndentationResult, apex_mm: float) -> dict[str, Any]:
    x, y = found.skin_profile
    return {
        "doi_mm": found.doi_mm,
        "force_gwt": found.force_gwt,
        "contact": [list(region) for region in found.contact_regions_mm],
        "skin": points(x, y - apex_mm),
    }


def section_of(job: Job, over: Callable[[], bool] = lambda: False) -> Section:
    """Return the section of a job, with `depths` of its press; a failure is in `problem`."""
    try:
        config = _finger_config(job.config, job.config.stat().st_mtime_ns)
        section = _still(config, job)
        if job.press is not None:
            try:
                with threadpool_limits(1):  # A run needs the other cores.
                    section["depths"] = depths_of(_finger(config), _shape(job), job.press, over)
            except ModelRangeError as error:
                section |= {"problem": str(error), "code": code_of(error)}
        return section
    except (BadInputError, ShapeError, OSError) as error:
        return {"problem": str(error), "code": code_of(error)}
    except Exception as error:  # A section beyond the model must not end the panel.
        return {"problem": f"{type(error).__name__}: {error}", "code": code_of(error)}


def _still(config: FingertipConfig, job: Job) -> Section:
    """Return finger and indentor without solving."""
    surface = FingertipSurface.fit(config.geometry)
    ridge = surface.ridge
    apex_mm = float(ridge(ridge.derivative().roots(extrapolate=False)).max())
    section: Section = finger_outlines(config, surface, config.receptor_plane_mm + job.along_mm, apex_mm)
    section["indentor"] = None if job.indentor is None else indentor_outline(_shape(job))
    return {**section, "along_mm": job.along_mm}


def _shape(job: Job) -> Indentor:
    assert job.indentor is not None
    return parse_shape(job.indentor if job.folder is None else from_copy(job.folder, job.indentor))


@lru_cache(maxsize=4)
def _finger_config(path: Path, written_ns: int) -> FingertipConfig:
    return load_config(path).finger


@lru_cache(maxsize=1)
def _finger(config: FingertipConfig) -> Fingertip:
    return Fingertip.load(config)
