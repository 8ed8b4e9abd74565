"""What every candidate answers in every scene, each candidate in a process of its own; what is done is kept."""

import json
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from sim.benchmark import of_level, peak_memory_mb
from sim.config import Contact
from sim.errors import ModelRangeError
from sim.models.catalogue import ModelName, load
from sim.models.result import IndentationResult
from sim.workers import in_processes
from studies.choice.drawn import DrawnScene

Row = dict[str, Any]


class Solver(NamedTuple):
    """A candidate for shapes that slope along some axes."""

    model: ModelName
    level: str
    axes: tuple[int, ...]
    share: float

    @property
    def name(self) -> str:
        """In what is kept."""
        return json.dumps(self)


@dataclass(frozen=True)
class SolverTask:
    """Scenes by their numbers, for one solver; patch_gb 0 refuses what leaves its patch."""

    solver: Solver
    scenes: tuple[tuple[int, DrawnScene], ...]
    patch_gb: float


def answers(tasks: Iterable[SolverTask], kept: Path) -> dict[tuple[str, int], Row]:
    """By solver and scene; solvers' costs under −1. Missing ones are made, one solver after the other."""
    known = _read(kept)
    for task in tasks:
        missing = tuple((n, scene) for n, scene in task.scenes if (task.solver.name, n) not in known)
        if not missing and (task.solver.name, -1) in known:
            continue
        for found in in_processes(_answered, [SolverTask(task.solver, missing, task.patch_gb)], 1):
            with kept.open("a", encoding="utf-8") as stream:
                stream.writelines(json.dumps(row) + "\n" for row in found)
        known = _read(kept)
    return known


def _read(kept: Path) -> dict[tuple[str, int], Row]:
    lines = kept.read_text(encoding="utf-8").splitlines() if kept.exists() else []
    return {(row["solver"], row["scene"]): row for row in map(json.loads, lines)}


def _answered(task: SolverTask) -> list[Row]:
    solver = task.solver
    candidate = of_level(solver.model, solver.level, solver.share)
    config = candidate.config.model_copy(update={"contact": Contact(patch_gb=task.patch_gb)})
    before = time.process_time()
    with threadpool_limits(1):
        finger = load(solver.model, config, slopes=solver.axes, cached=False)
        model = finger.model_for(solver.axes)
        built_s, memory_mb = time.process_time() - before, peak_memory_mb()
        laps = model.timing_s
        share = (laps.get("recovery", 0) + laps.get("receptors", 0)) / sum(laps.values()) if laps else 0.0
        cost = {"build_s": built_s, "receptors_s": share * built_s, "memory_mb": memory_mb}
        rows = [{"solver": solver.name, "scene": -1, "nodes": model.nodes, "patch_nodes": len(model.patch), **cost}]
        for n, scene in task.scenes:
            rows.append({"solver": solver.name, "scene": n, **_pressed(finger, scene)})
    return rows


def _pressed(finger: Any, scene: DrawnScene) -> Row:
    try:
        result = finger.indent(
            scene.indentor, scene.x_mm, z_mm=scene.z_mm, doi_mm=scene.doi_mm, force_gwt=scene.force_gwt
        )
    except ModelRangeError as error:
        return {"refused": str(error)}
    return _values(result)


def _values(result: IndentationResult) -> Row:
    measures = result.receptor_measures
    return {
        "force": [result.force_n],
        "doi": [result.doi_mm],
        "width": [sum(right - left for left, right in result.contact_regions_mm)],
        "sed": measures["sed"].tolist(),
        "ep1": measures["ep1"].tolist(),
        "press_s": result.contact_s,
        "converged": result.state.converged,
        "grown": result.model.widened_mm is not None,
    }


def error(found: Mapping[str, Any], right: Mapping[str, Any], quantity: str, *, by_force: bool) -> float:
    """Largest deviation over the largest value; of a press to a force the depth's stands for the force's."""
    name = "doi" if by_force and quantity == "force" else quantity
    there, expected = np.array(found[name]), np.array(right[name])
    largest = np.abs(expected).max()
    return float(np.abs(there - expected).max() / largest) if largest else float(np.abs(there).max() > 0)


def numbered(
    scenes: Sequence[DrawnScene], solvers: Mapping[int, Iterable[Solver]], patch_gb: float
) -> list[SolverTask]:
    """The tasks of scenes that some solvers are to answer, by the scene's number."""
    of: dict[Solver, list[tuple[int, DrawnScene]]] = {}
    for n, some in solvers.items():
        for solver in some:
            of.setdefault(solver, []).append((n, scenes[n]))
    return [SolverTask(solver, tuple(listed), patch_gb) for solver, listed in of.items()]
