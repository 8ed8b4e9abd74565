"""One drawing: the finger's section, the indentor in front of it, and what its press is expected to do."""

from functools import lru_cache
from pathlib import Path
from typing import Any

from rig.errors import code_of
from rig.panel.drawn.foreseen import foreseen
from rig.panel.drawn.job import Job
from rig.panel.drawn.outlines import finger_outlines, indentor_outline
from rig.plan.config import load_config
from rig.plan.shape_files import from_copy
from rig.protocol.errors import BadInputError
from sim.config import FingertipConfig
from sim.contact.indentor import Indentor
from sim.contact.shapes import ShapeError, parse_shape
from sim.finger.surface import FingertipSurface
from sim.models.fingertip import Fingertip

Drawing = dict[str, Any]


def drawn(job: Job) -> Drawing:
    """The section of a job, with `prediction` where it has a press; what cannot be had is told in `problem`."""
    try:
        config = _finger_config(job.config, _written_ns(job.config))
        told = _still(config, job)
        return told if job.press is None else _pressed(config, job, told)
    except (BadInputError, ShapeError, OSError) as error:
        return {"problem": str(error), "code": code_of(error)}
    except Exception as error:  # a scene beyond the model must not end this process
        return {"problem": f"{type(error).__name__}: {error}", "code": code_of(error)}


def _still(config: FingertipConfig, job: Job) -> Drawing:
    """Finger and indentor, with nothing solved."""
    surface = FingertipSurface.fit(config.geometry)
    ridge = surface.ridge
    apex_mm = float(ridge(ridge.derivative().roots(extrapolate=False)).max())
    told: Drawing = finger_outlines(config, surface, config.receptor_plane_mm + job.along_mm, apex_mm)
    told["indentor"] = None if job.indentor is None else indentor_outline(_shape(job))
    return {**told, "along_mm": job.along_mm}


def _pressed(config: FingertipConfig, job: Job, told: Drawing) -> Drawing:
    assert job.press is not None
    prediction, at_target = foreseen(_finger(config), _shape(job), job.press)
    return {**told, **at_target, "prediction": prediction}


def _shape(job: Job) -> Indentor:
    assert job.indentor is not None
    return parse_shape(job.indentor if job.folder is None else from_copy(job.folder, job.indentor))


@lru_cache(maxsize=4)
def _finger_config(path: Path, written_ns: int) -> FingertipConfig:
    return load_config(path).finger


def _written_ns(path: Path) -> int:
    return path.stat().st_mtime_ns


@lru_cache(maxsize=1)
def _finger(config: FingertipConfig) -> Fingertip:
    return Fingertip.load(config)
