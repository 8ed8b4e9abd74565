"""How far the answers under sharp shapes hang on the path, and on where the nodes lie.

    .venv/bin/python -m studies.accuracy.branches            # docs/validation/hard_cases.md; some minutes
    .venv/bin/python -m studies.accuracy.branches --flagged  # the last of them alone

First table: scenes solved at once from rest, pressed in by equal steps and as `rig indent` does it, against steps of
0.0125 mm: near the middle of the finger, and at places and depths drawn at random. Second: the same shape at 8 places
over one element; what a parabola over two elements leaves is scatter of the discretisation, with contact at nodes
only and also between them. Third: which answers depend on the path (steps of 0.0125 or 0.00625 mm, each solved in
full, end elsewhere), which are flagged, what `other_paths` finds and costs; random poses are those of `random_poses`
that lie along the finger, without cylinders.
"""

import sys
import time
from collections.abc import Iterable
from itertools import product

import numpy as np
from numpy.typing import NDArray

from sim.config import Contact, FingertipConfig, MeshSpec
from sim.contact.indentor import Indentor
from sim.contact.measured_profile import MeasuredProfile
from sim.contact.profiles import Bar, Grating, IndentorProfile, SinusoidalStep, Wedge
from sim.contact.solver import ContactState
from sim.errors import ModelRangeError
from sim.models.fingertip import Fingertip
from sim.models.pressing import OTHER_STEPS_MM
from studies.accuracy.random_poses import ON_ITS_PATCH, ROUND_OR_LINE, draw

Shape = Indentor | IndentorProfile
Pose = tuple[Shape, float, float]  # x and DOI in mm
Array = NDArray[np.float64]

FINEST_MM = 0.0125
SAME = 1e-8
PATHS_MM = {"at once": 9.0, "by 0.2 mm": 0.2, "by 0.1 mm": 0.1, "by 0.05 mm": 0.05, "as `rig indent`": 0.0}
ZIGZAG = MeasuredProfile("zigzag", (-1.6, -0.8, 0.0, 0.8, 1.6), (0.3, 0.0, 0.3, 0.0, 0.3), linear=True)
_UNEVEN: tuple[IndentorProfile, ...] = (Grating(0.5, 1.2), ZIGZAG)
ROUNDED: list[Pose] = [
    *product([SinusoidalStep("1")], (1.0, 0.0, -0.5, -1.0, -1.2, -1.63, -1.8, -2.25), (0.2, 0.3, 0.4, 0.73, 1.0)),
    *product([SinusoidalStep("3")], (-1.0, 0.0), (0.73,)),
    *product([Bar(1.5), Bar(3.0)], (-0.3, 0.0, 0.25), (0.4, 0.73, 1.0)),
    *product([Wedge(60.0)], (0.0, 0.3, -0.5), (0.2, 0.4, 0.6)),
    *product(_UNEVEN, (0.1, 0.3), (0.3, 0.6)),
]
EDGES: list[Pose] = [
    *product([Bar(1.5, 0.0), Bar(1.5, 0.01)], (-0.3, 0.0, 0.25), (0.4, 0.73, 1.0)),
    *product([Wedge(60.0, 0.0)], (0.0, 0.3, -0.5), (0.2, 0.4, 0.6)),
]
_SHAPES = (
    Bar(1.5),
    Bar(3.0),
    SinusoidalStep("1"),
    SinusoidalStep("3"),
    Wedge(60.0),
    Wedge(40.0),
    Grating(0.5, 1.2),
    ZIGZAG,
)
_EACH, RANDOM = 10, 100
_RNG = np.random.default_rng(0)
ANYWHERE: list[Pose] = [
    (shape, round(float(_RNG.uniform(-1.7, 1.7)), 3), round(float(_RNG.uniform(0.2, 1.3)), 3))
    for shape in _SHAPES
    for _ in range(_EACH)
]
OFFSETS = 8
PLACES: dict[str, Pose] = {
    "step 1, DOI 0.2": (SinusoidalStep("1"), -1.63, 0.2),
    "step 1, DOI 0.73": (SinusoidalStep("1"), -1.63, 0.73),
    "bar 1.5, DOI 0.73": (Bar(1.5), 0.0, 0.73),
    "bar 1.5, edge radius 0, DOI 0.73": (Bar(1.5, 0.0), 0.0, 0.73),
    "wedge 60, DOI 0.4": (Wedge(60.0), 0.0, 0.4),
}


def pressed(finger: Fingertip, pose: Pose, step_mm: float) -> float:
    """Force in gwt at the end of a path in steps; 0: as `rig indent` does it."""
    profile, x, doi = pose
    if not step_mm:
        return finger.indent(profile, x, doi_mm=doi).force_gwt
    state: ContactState | None = None
    for depth in (*np.arange(min(step_mm, doi), doi - 1e-9, step_mm), doi):
        result = finger.indent(profile, x, doi_mm=float(depth), start=state or _at_rest(finger))
        state = result.state
    return result.force_gwt


def paths(finger: Fingertip, poses: list[Pose]) -> Iterable[tuple[str, Array, float]]:
    """Of each path its name, the forces relative to the finest path less one, and its processor seconds a pose."""
    finest = np.array([pressed(finger, pose, FINEST_MM) for pose in poses])
    for name, step in PATHS_MM.items():
        began = time.process_time()
        force = np.array([pressed(finger, pose, step) for pose in poses])
        yield name, force / finest - 1, (time.process_time() - began) / len(poses)


def _at_rest(finger: Fingertip) -> ContactState:
    """No contact: a start that keeps `indent` from pressing in by itself."""
    return finger.indent("bar:3.0", 0.0, doi_mm=1e-6).state


def scatter(finger: Fingertip, pose: Pose) -> float:
    """Largest distance of forces over two elements of places from their parabola, over their mean."""
    shape, x, doi = pose
    offset = np.arange(-OFFSETS, OFFSETS + 1) * MeshSpec().spacing_mm / OFFSETS
    force = np.array([finger.indent(shape, float(x + o), doi_mm=doi).force_gwt for o in offset])
    return float(np.abs(force - np.polyval(np.polyfit(offset, force, 2), offset)).max() / force.mean())


def random_poses(finger: Fingertip, n: int, seed: int) -> list[Pose]:
    """Shapes along the finger at random, cylinders left out, within the patch."""
    rng, found = np.random.default_rng(seed), list[Pose]()
    while len(found) < n:
        scene = draw(rng)
        if scene.family in ("cylinder", *ROUND_OR_LINE):
            continue
        try:
            finger.indent(scene.indentor, scene.x_mm, doi_mm=scene.doi_mm)
        except ModelRangeError:
            continue
        found.append((scene.indentor, scene.x_mm, scene.doi_mm))
    return found


def flagged(finger: Fingertip, poses: list[Pose]) -> Iterable[str]:
    """Cells of the table of flags, for some poses."""
    depends, flag, spread = [], [], []
    own_s = other_s = 0.0
    for shape, x, doi in poses:
        began = time.process_time()
        own = finger.indent(shape, x, doi_mm=doi)
        middle = time.process_time()
        other = finger.indent(shape, x, doi_mm=doi, other_paths=True)
        own_s, other_s = own_s + middle - began, other_s + time.process_time() - middle
        off = [abs(pressed(finger, (shape, x, doi), step) / own.force_gwt - 1) for step in OTHER_STEPS_MM]
        depends.append(max(off) > SAME)
        flag.append(own.may_depend_on_path)
        spread.append(other.path_spread or 0.0)
    d, f, seen = np.array(depends), np.array(flag), np.array(spread) > SAME
    counts = (len(poses), *map(np.sum, (d, d & f, d & ~f, f & ~d, ~f, seen & d, seen & ~d)))
    return (*map(str, counts), f"{max(spread):.1%}", f"{other_s / own_s:.1f}")


def flags(finger: Fingertip) -> None:
    """Print the third table."""
    _row("group", ("poses", "depend on the path", "of these flagged", "not flagged", "flagged and do not depend",
                   "not flagged in all", "found by `other_paths`", "found beyond", "largest spread found",
                   "time with `other_paths` over that without"))  # fmt: skip
    print("|---|---|---|---|---|---|---|---|---|---|---|")
    random = random_poses(Fingertip.load(ON_ITS_PATCH), RANDOM, seed=7)
    groups = {"edges of 0.01 mm and 0": EDGES, "anywhere": ANYWHERE, "random": random, "middle": ROUNDED}
    for name, poses in groups.items():
        _row(name, flagged(finger, poses))


def _row(name: str, cells: Iterable[str]) -> None:
    print(f"| {name} | {' | '.join(cells)} |", flush=True)


def main() -> None:
    """Print both tables."""
    finger = Fingertip.load()
    if "--flagged" in sys.argv:
        flags(finger)
        return
    _row("path", ("edges", "poses that differ by more than 1e-8", "by at most", "processor ms a pose"))
    print("|---|---|---|---|---|")
    groups = {"rounded, near the middle": ROUNDED, "rounded, anywhere": ANYWHERE, "0.01 mm, 0": EDGES}
    for edges, poses in groups.items():
        for name, off, seconds in paths(finger, poses):
            differ = int((np.abs(off) > SAME).sum())
            _row(name, (edges, f"{differ} of {len(poses)}", f"{np.abs(off).max():.1e}", f"{1e3 * seconds:.0f}"))
    print()
    nodes_only = Fingertip.load(FingertipConfig(contact=Contact(between_nodes=False)))
    _row("pose", ("scatter, nodes only", "scatter, also between nodes"))
    print("|---|---|---|")
    for name, pose in PLACES.items():
        _row(name, (f"{scatter(f, pose):.2%}" for f in (nodes_only, finger)))
    print()
    flags(finger)


if __name__ == "__main__":
    main()
