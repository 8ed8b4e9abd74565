"""Strain in the receptor plane at a few positions of each schedule, for the report."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray

from rig.compare.stimuli import Stimulus, responses_key
from rig.data import Run
from sim.contact.shapes import parse_shape
from sim.measures.measures import shown
from sim.models.cache import Arrays, cached_arrays, content_key
from sim.models.fingertip import Fingertip
from sim.models.full_mesh import strain_maps

Array = NDArray[np.float64]

MAPPED = ("sed", "ep1")
_SHOWN_POSITIONS = 3


@dataclass(frozen=True)
class StimulusMap:
    """One stimulus at one position, deformed: corners (n + 1, m + 1, 2), receptors (r, 2), values (n, m)."""

    stimulus: Stimulus
    x_mm: float
    corner_mm: Array
    receptor_mm: Array
    values: dict[str, Array]  # in the signs of `shown`


def stimulus_maps(run: Run, finger: Fingertip, stimuli: Sequence[Stimulus]) -> list[StimulusMap]:
    """Maps at three positions of each stimulus of a run, fewer of a shorter schedule; cached like its responses."""
    scenes = [(stimulus, k) for stimulus in stimuli for k in _positions(len(stimulus.x_mm))]
    key = content_key(["stimulus maps", *MAPPED, _SHOWN_POSITIONS, responses_key(run, finger)])
    arrays, _ = cached_arrays(key, lambda: _arrays(finger, scenes), kind="answers")
    found = cast(dict[str, Array], arrays)
    return [_from_arrays(stimulus, k, found, n) for n, (stimulus, k) in enumerate(scenes)]


def _from_arrays(stimulus: Stimulus, k: int, found: dict[str, Array], n: int) -> StimulusMap:
    values = {name: found[f"{name} {n}"] for name in MAPPED}
    return StimulusMap(stimulus, float(stimulus.x_mm[k]), found[f"corner {n}"], found[f"receptor {n}"], values)


def _positions(n: int) -> list[int]:
    """A quarter, half and three quarters of the way through a schedule."""
    quarters = np.arange(1, _SHOWN_POSITIONS + 1) / (_SHOWN_POSITIONS + 1)
    return sorted({int(k) for k in np.round(quarters * (n - 1))})


def _arrays(finger: Fingertip, scenes: Sequence[tuple[Stimulus, int]]) -> Arrays:
    shapes = {name: parse_shape(name) for name in {s.read_as for s, _ in scenes}}
    results = [
        finger.indent(shapes[s.read_as], shapes[s.read_as].lateral_mm(float(s.x_mm[k])), doi_mm=float(s.doi_mm[k]))
        for s, k in scenes
    ]
    maps = strain_maps(finger.config, results) if results else []
    arrays: Arrays = {}
    for n, one in enumerate(maps):  # a mesh for each kind of indentor: they need not be of one size
        arrays[f"corner {n}"] = one.moved_mm
        arrays[f"receptor {n}"] = one.carried(finger.model.receptors.position_mm[:, :2])
        arrays |= {f"{name} {n}": shown(name, one.measures[name]) for name in MAPPED}
    return arrays
