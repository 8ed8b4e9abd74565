"""Spatial response profiles in other worlds: another Poisson's ratio, friction, finite strain.

    OMP_NUM_THREADS=1 .venv/bin/python -m studies.finite_strain.worlds FILE [WORLD[@SHAPE] …]

Steps at 2.33 and 8 gwt and bars at DOI 1.0, each press written when it is done. A section's "8 gwt" is the force per
mm that its linear, frictionless self at ν = 0.48 carries where the source's finger carries 8 gwt: under step 1 at
−1.63 mm, 0.73 mm deep.
"""

import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from sim.config import E_EPIDERMIS_MPA, Contact, FingertipConfig, MeshSpec, Tissue
from sim.contact.shapes import parse_shape
from sim.measures.measures import MEASURES, measures_in_layers
from sim.models.catalogue import load
from sim.models.fingertip import Fingertip
from sim.units import GWT_N
from studies.finite_strain.reading import Reader
from studies.finite_strain.solver.body import Body
from studies.finite_strain.solver.inside import InteriorPoints
from studies.finite_strain.solver.laws import NeoHookean
from studies.finite_strain.solver.press import presses
from studies.finite_strain.solver.rubbing import Rubbing
from studies.finite_strain.solver.scene import Specimen

Array = NDArray[np.float64]

STEP_X_MM = (
    -5.7,
    -4.7,
    -3.69,
    -3.25,
    -2.75,
    -2.25,
    *np.arange(-1.97, 0.2, 0.17).round(2).tolist(),
    0.5,
    1.0,
    1.5,
    2.0,
)
BAR_X_MM = {"bar:1.5": 6, "bar:3.0": 8}  # positions to each side, 0.34 mm apart
BAR_SPACING_MM, BAR_DOI_MM = 0.34, 1.0
FORCES_GWT = (2.33, 8.0)
_AS_8_GWT = ("step:1", -1.63, 0.73)
_DEEPEST_MM, _STEP_MM = 2.0, 0.1


@dataclass(frozen=True)
class StrainWorld:
    """What differs from the default."""

    kind: Literal["section", "finger"] = "section"
    poisson: float = 0.48
    friction: float = 0.0
    finite: bool = False
    every: int = 1  # so many places of the schedules, from their first, are pressed

    @property
    def config(self) -> FingertipConfig:
        """Of its finger; a whole one is the coarse level."""
        mesh = MeshSpec.model_validate({"level": "coarse"} if self.kind == "finger" else {})
        return FingertipConfig(tissue=Tissue(poisson=self.poisson), mesh=mesh, contact=Contact(between_nodes=False))


WORLDS: dict[str, StrainWorld] = {
    "section": StrainWorld(),
    "section, nu 0.45": StrainWorld(poisson=0.45),
    "section, nu 0.49": StrainWorld(poisson=0.49),
    "section, nu 0.499": StrainWorld(poisson=0.499),
    "section, friction 0.3": StrainWorld(friction=0.3),
    "section, finite strain": StrainWorld(finite=True),
    "finger": StrainWorld("finger"),
    "finger, nu 0.499": StrainWorld("finger", poisson=0.499),
    "finger, friction 0.3": StrainWorld("finger", friction=0.3, every=2),
}


def presses_wanted(every: int = 1) -> Iterator[tuple[str, float]]:
    """Shape and place of each."""
    for number in "135":
        yield from ((f"step:{number}", x) for x in STEP_X_MM[::every])
    for bar, n in BAR_X_MM.items():
        yield from ((bar, round(BAR_SPACING_MM * k, 2)) for k in range(-n, n + 1, every))


@cache
def _eight_gwt_per_mm() -> float:
    """N/mm of the default section for E(epidermis) = 1 MPa."""
    shape, x_mm, doi_mm = _AS_8_GWT
    finger = load("section", StrainWorld().config, cached=False)
    return finger.indent(shape, x_mm, doi_mm=doi_mm).force_n / finger.e_epidermis_mpa


def target_force(world: StrainWorld, force_gwt: float) -> float:
    """N, of a section per mm, for E(epidermis) = 1 MPa."""
    return force_gwt / 8.0 * _eight_gwt_per_mm() if world.kind == "section" else force_gwt * GWT_N / E_EPIDERMIS_MPA


class States:
    """A press on the way down: depth, force and measures (18, n_receptors) at each of its increments."""

    def __init__(self, world: StrainWorld) -> None:
        self._world = world

    def way(self, shape: str, x_mm: float, most: float, deepest_mm: float) -> list[tuple[float, float, Array]]:
        """Down to a force or depth, whichever comes first; the last may lie beyond the force."""
        found = []
        for doi, force, measures in (self._finite if self._world.finite else self._linear)(shape, x_mm, deepest_mm):
            found.append((doi, force, measures))
            if force >= most:
                break
        return found

    def _linear(self, shape: str, x_mm: float, deepest_mm: float) -> Iterator[tuple[float, float, Array]]:
        finger, world = _finger(self._world), self._world
        rubbing = Rubbing(
            finger.model.patch, parse_shape(shape), x_mm, finger.touch_height_mm(shape, x_mm), world.friction
        )
        ratio = finger.model.columns.young_ratio
        for rubbed in rubbing.presses(deepest_mm):
            found = measures_in_layers(finger.model.strain(rubbed.force), ratio, world.poisson)
            yield rubbed.doi_mm, rubbed.normal_force, np.array([found[name] for name in MEASURES])

    def _finite(self, shape: str, x_mm: float, deepest_mm: float) -> Iterator[tuple[float, float, Array]]:
        (specimen, body, receptors), law = _finite_one(self._world), NeoHookean()
        depths = np.append(np.arange(_STEP_MM, deepest_mm - 1e-9, _STEP_MM), deepest_mm)
        for pressed in presses(body, specimen.skin, specimen.touch(shape, x_mm), depths.tolist(), _STEP_MM):
            found = receptors.measures(body.displacement(pressed.unknowns), law)
            yield pressed.doi_mm, pressed.force, np.array([found[name] for name in MEASURES])


@cache
def _finger(world: StrainWorld) -> Fingertip:
    return load(world.kind, world.config, cached=False)


@cache
def _finite_one(world: StrainWorld) -> tuple[Specimen, Body, InteriorPoints]:
    specimen = Specimen(world.config, world.kind)
    return specimen, specimen.body(NeoHookean()), Reader(specimen).receptors


def main(path: str, *names: str) -> None:
    """Append what is missing."""
    file = Path(path)
    done = {(row["world"], row["shape"], row["x_mm"]) for row in read(file)}
    for named in names or WORLDS:
        name, _, only = named.partition("@")
        for shape, x_mm in presses_wanted(WORLDS[name].every):
            if (name, shape, x_mm) in done or not shape.startswith(only):
                continue
            with file.open("a", encoding="utf-8") as out:
                for row in rows(name, shape, x_mm):
                    out.write(json.dumps(row) + "\n")
        print(name, flush=True)


def rows(name: str, shape: str, x_mm: float) -> Iterator[dict[str, Any]]:
    """One a target; measures None where it was not reached."""
    world = WORLDS[name]
    if world.kind == "finger" and not world.friction:
        yield from _by_the_model(name, shape, x_mm)
        return
    states = States(world)
    if shape.startswith("bar"):
        way = states.way(shape, x_mm, np.inf, BAR_DOI_MM)
        reached = bool(way) and abs(way[-1][0] - BAR_DOI_MM) < 1e-9
        yield _row(name, shape, x_mm, f"{BAR_DOI_MM:g} mm", way[-1] if reached else None)
        return
    targets = {gwt: target_force(world, gwt) for gwt in FORCES_GWT}
    way = states.way(shape, x_mm, max(targets.values()), _DEEPEST_MM)
    for gwt, force in targets.items():
        yield _row(name, shape, x_mm, f"{gwt:g} gwt", between(way, force))


def _by_the_model(name: str, shape: str, x_mm: float) -> Iterator[dict[str, Any]]:
    """The project's own presses: without friction, and at a force without increments."""
    finger = _finger(WORLDS[name])
    depths: dict[str, dict[str, float]] = {f"{BAR_DOI_MM:g} mm": {"doi_mm": BAR_DOI_MM}}
    forces: dict[str, dict[str, float]] = {f"{gwt:g} gwt": {"force_gwt": gwt} for gwt in FORCES_GWT}
    for target, asked in (depths if shape.startswith("bar") else forces).items():
        found = finger.indent(shape, x_mm, **asked)  # type: ignore[arg-type]
        measures = np.array([found.receptor_measures[measure] for measure in MEASURES])
        yield _row(name, shape, x_mm, target, (found.doi_mm, found.force_n / finger.e_epidermis_mpa, measures))


def between(way: list[tuple[float, float, Array]], force: float) -> tuple[float, float, Array] | None:
    """Linear between the increments around a force, from rest at its first; None beyond the last."""
    states = [(0.0, 0.0, np.zeros_like(way[0][2])), *way] if way else []
    for (doi, low, before), (further, high, after) in pairwise(states):
        if high >= force:
            share = (force - low) / (high - low)
            return doi + share * (further - doi), force, before + share * (after - before)
    return None


def _row(name: str, shape: str, x_mm: float, target: str, state: tuple[float, float, Array] | None) -> dict[str, Any]:
    found = {"world": name, "shape": shape, "x_mm": x_mm, "target": target}
    if state is None:
        return {**found, "doi_mm": None, "force": None, "measures": None}
    return {**found, "doi_mm": state[0], "force": state[1], "measures": np.round(state[2], 9).tolist()}


def read(file: Path) -> list[dict[str, Any]]:
    """The rows that are there."""
    return [json.loads(line) for line in file.read_text("utf-8").splitlines()] if file.exists() else []


if __name__ == "__main__":
    main(*sys.argv[1:])
