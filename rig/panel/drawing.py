"""Drawing of the section of the finger and the indentor for a page, in a separate process."""

import asyncio
import contextlib
import math
import multiprocessing
import signal
import sys
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rig.clock import Clock
from rig.errors import BadInputError, RigError
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
from sim.workers import give_way, leaving_ctrl_c_to_us

if TYPE_CHECKING:
    if sys.platform == "win32":
        from multiprocessing.connection import PipeConnection as Connection
    else:
        from multiprocessing.connection import Connection

    PipeEnd = Connection[Any, Any]


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
    """Inputs of a drawing: configuration, run folder with copies of the shape files, indentor and press."""

    config: Path
    folder: Path | None = None
    indentor: str | None = None
    along_mm: float = 0.0  # from the receptor plane
    press: PressSummary | None = None


PATIENCE_S = 120.0
"""Longest wait for a drawing (s); a larger patch takes a minute on a busy machine."""
_GIVES_WAY = 10
"""Nice value of the drawing process, so that it yields to motion and to the model behind it."""

DrawingAnswer = dict[str, Any]
"""Reply with `section`, `prediction` for a press, or `problem`."""


class DrawingError(RigError):
    """Error of a missing drawing."""

    default_code = "not_drawn"


class DrawingProcess:
    """Process that draws one job at a time; started with the first job, and again after a loss."""

    def __init__(self) -> None:
        self._process: multiprocessing.process.BaseProcess | None = None
        self._near: PipeEnd | None = None
        self._changing = threading.Lock()

    def ask(self, job: Job) -> DrawingAnswer:
        """Return a drawing. Raises DrawingError; a section that cannot be drawn is a `problem` in the reply."""
        try:
            near = self._begun()
            near.send(job)
            if near.poll(PATIENCE_S):
                return near.recv()
        except (EOFError, OSError):
            self.close()
            raise DrawingError("the drawing process ended; reload the page", "process_ended") from None
        self.close()
        raise DrawingError(f"the drawing was not ready within {PATIENCE_S:g} s; reload the page", "too_slow")

    def close(self) -> None:
        """End the process."""
        with self._changing:
            process, near = self._process, self._near
            self._process = self._near = None
        if process is not None and near is not None:
            process.kill()  # First, so that a waiting thread notices the end.
            process.join()
            near.close()

    def _begun(self) -> "PipeEnd":
        with self._changing:
            if self._near is None:
                context = multiprocessing.get_context("spawn")
                self._near, far = context.Pipe()
                self._process = context.Process(target=_serve, args=(far,), daemon=True)
                with leaving_ctrl_c_to_us():
                    self._process.start()
                far.close()
            return self._near


def _serve(far: "PipeEnd") -> None:
    give_way(_GIVES_WAY)

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with contextlib.suppress(EOFError, OSError):
        while True:
            far.send(drawn(far.recv()))


_POLL_S = 0.05
NO_CURVE: DrawingAnswer = {"doi_mm": None, "force_gwt": None}


class Drawer:
    """Draws the latest requested section; superseded requests are dropped."""

    def __init__(self, request: Callable[[], Job | None], outlet: Outlet, clock: Clock) -> None:
        self._request, self._outlet, self._clock = request, outlet, clock
        self.process = DrawingProcess()
        self._thread = ThreadPoolExecutor(1, "drawing")
        self._drawn: Job | None = None
        self._announced_for: Job | None = None

    async def follow(self) -> None:
        """Draw until cancelled."""
        while True:
            await self.look()
            await asyncio.sleep(_POLL_S)

    async def look(self) -> None:
        """Draw the next part: finger and indentor first, since solving takes longer."""
        job = self._request()
        if job != self._announced_for:
            self._announced_for = job
            self._publish_prediction(job, NO_CURVE)
        if job is None or job == self._drawn:
            return
        still = replace(job, press=None)
        if self._drawn is None or replace(self._drawn, press=None) != still:
            await self._draw(still)
        else:
            await self._draw(job)

    async def _draw(self, job: Job) -> None:
        try:
            section = await asyncio.get_running_loop().run_in_executor(self._thread, self.process.ask, job)
        except DrawingError as error:
            section = {"problem": str(error), "code": error.code}
        self._drawn = job
        prediction = section.pop("prediction", NO_CURVE)
        self._outlet.publish("section", {**self._about(job), "skin": [], **section})
        if job.press is not None and job == self._request():
            self._publish_prediction(job, prediction)

    def _publish_prediction(self, job: Job | None, curve: DrawingAnswer) -> None:
        self._outlet.publish("prediction", {**self._about(job), **curve})

    def _about(self, job: Job | None) -> dict[str, Any]:
        """Return the fields that identify a drawing."""
        press = None if job is None else job.press
        return {
            "unix_s": self._clock.unix_s(),
            "run": None if job is None or job.folder is None else job.folder.name,
            "index": None if press is None else press.index,
            "purpose": None if press is None else press.purpose,
            "shape": None if job is None else job.indentor,
        }

    def close(self) -> None:
        """End the drawing process."""
        self.process.close()
        self._thread.shutdown(wait=False)


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
NONE: dict[str, Any] = {"doi_mm": None, "force_gwt": None}


def predicted(finger: Fingertip, shape: Indentor, press: PressSummary) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the predicted curve, with skin and contact at the target; empty without a prediction."""
    try:
        x_mm, ways = shape.lateral_mm(press.x_mm), finger.keeping_ways()
        last = ways.indent(shape, x_mm, **{press.target: press.value})  # type: ignore[arg-type]
        depths = last.doi_mm * np.arange(1, DEPTHS) / DEPTHS
        found = [ways.indent(shape, x_mm, doi_mm=float(doi_mm)) for doi_mm in depths]
    except ModelRangeError as error:
        return {**NONE, "problem": str(error), "code": code_of(error)}, {}
    curve = [one for one in [*found, last] if one.state.converged]
    prediction = {
        "doi_mm": [0.0, *(one.doi_mm for one in curve)],
        "force_gwt": [0.0, *(one.force_gwt for one in curve)],
    }
    return prediction, _at_target(last, finger.apex_height_mm) if last.state.converged else {}


def _at_target(found: IndentationResult, apex_mm: float) -> dict[str, Any]:
    x, y = found.skin_profile
    return {
        "contact": [list(region) for region in found.contact_regions_mm],
        "pressed_skin": points(x, y - apex_mm),
    }


Drawing = dict[str, Any]


def drawn(job: Job) -> Drawing:
    """Return the section of a job, with `prediction` for a press; a failure is in `problem`."""
    try:
        config = _finger_config(job.config, job.config.stat().st_mtime_ns)
        section = _still(config, job)
        return section if job.press is None else _pressed(config, job, section)
    except (BadInputError, ShapeError, OSError) as error:
        return {"problem": str(error), "code": code_of(error)}
    except Exception as error:  # A scene beyond the model must not end this process.
        return {"problem": f"{type(error).__name__}: {error}", "code": code_of(error)}


def _still(config: FingertipConfig, job: Job) -> Drawing:
    """Return finger and indentor without solving."""
    surface = FingertipSurface.fit(config.geometry)
    ridge = surface.ridge
    apex_mm = float(ridge(ridge.derivative().roots(extrapolate=False)).max())
    section: Drawing = finger_outlines(config, surface, config.receptor_plane_mm + job.along_mm, apex_mm)
    section["indentor"] = None if job.indentor is None else indentor_outline(_shape(job))
    return {**section, "along_mm": job.along_mm}


def _pressed(config: FingertipConfig, job: Job, section: Drawing) -> Drawing:
    assert job.press is not None
    prediction, at_target = predicted(_finger(config), _shape(job), job.press)
    return {**section, **at_target, "prediction": prediction}


def _shape(job: Job) -> Indentor:
    assert job.indentor is not None
    return parse_shape(job.indentor if job.folder is None else from_copy(job.folder, job.indentor))


@lru_cache(maxsize=4)
def _finger_config(path: Path, written_ns: int) -> FingertipConfig:
    return load_config(path).finger


@lru_cache(maxsize=1)
def _finger(config: FingertipConfig) -> Fingertip:
    return Fingertip.load(config)
