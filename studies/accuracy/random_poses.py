"""Contact at random shapes and poses: does every one converge, and in how many passes?

    .venv/bin/python -m studies.accuracy.random_poses [N] [SEED]    # 2000 poses by default, about eight minutes

At least 80 % of the poses have 20 active nodes or more and a quarter touch an edge or have two regions; poses that
would leave the patch are drawn anew. The tests run a small part of the same draw.
"""

import sys
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sim.config import Contact, FingertipConfig
from sim.contact.indentor import Indentor, Revolved
from sim.contact.measured_profile import MeasuredProfile
from sim.contact.patch import X, Z
from sim.contact.profiles import Bar, Cylinder, Grating, IndentorProfile, SinusoidalStep, Wedge
from sim.contact.shapes import parse_shape
from sim.contact.solver import TARGET_RESIDUAL
from sim.errors import ModelRangeError
from sim.models.fingertip import Fingertip
from sim.models.result import IndentationResult

PRISMATIC = ("step", "bar", "sharp bar", "cylinder", "grating", "wedge", "profile", "kinked profile")
ROUND_OR_LINE = ("sphere", "cone", "flat", "line")
FAMILIES = PRISMATIC + ROUND_OR_LINE

ON_ITS_PATCH = FingertipConfig(contact=Contact(patch_gb=0))
"""The default finger; what leaves the mesh's own patch is refused."""


@dataclass(frozen=True)
class PosedShape:
    """One random shape in one random pose."""

    family: str
    indentor: Indentor
    x_mm: float
    z_mm: float | None  # None: the receptor plane
    doi_mm: float


def draw(rng: np.random.Generator) -> PosedShape:
    """A random scene; depths are drawn so that most contacts are large."""
    family = str(rng.choice(FAMILIES))
    if family in ROUND_OR_LINE:
        return _round_or_line(rng, family)
    x = float(rng.uniform(-3.7, 2.0) if family == "step" else rng.uniform(-1.8, 1.8))
    deepest = 1.0 if family == "step" else 1.33
    return PosedShape(family, Indentor.along(_profile(rng, family)), x, None, float(deepest * rng.uniform(0.12, 1.0)))


def _profile(rng: np.random.Generator, family: str) -> IndentorProfile:
    if family == "step":
        return SinusoidalStep(str(rng.choice(["1", "3", "5"])))
    if family == "bar":
        return Bar(float(rng.uniform(0.8, 3.5)), float(rng.uniform(0.02, 0.2)))
    if family == "sharp bar":
        return Bar(float(rng.uniform(0.8, 3.5)), float(rng.choice([0.01, 0.001, 0.0])))
    if family == "cylinder":
        return Cylinder(float(10 ** rng.uniform(0.3, 1.4)))
    if family == "grating":
        ridge = float(rng.uniform(0.3, 1.5))
        return Grating(ridge, ridge + float(rng.uniform(0.3, 1.5)))
    if family == "wedge":
        return Wedge(float(rng.uniform(30, 85)))
    return MeasuredProfile("random", *random_profile(rng), linear=family == "kinked profile")


def _round_or_line(rng: np.random.Generator, family: str) -> PosedShape:
    """Shapes placed off the receptor plane too; narrow ones deeper, as they touch few nodes."""
    x, z = float(rng.uniform(-0.9, 0.9)), 6.893 + float(rng.uniform(-0.9, 0.9))
    deep = float(rng.uniform(0.2, 1.0))
    if family == "line":
        return PosedShape(family, parse_shape("line"), 0.0, z, 1.2 * deep)
    if family == "sphere":
        shape = Revolved("sphere", Cylinder(float(10 ** rng.uniform(0.2, 1.3))))
    elif family == "cone":
        shape = Revolved("cone", Wedge(float(rng.uniform(55, 85))))
    else:
        shape = Revolved("flat", Bar(float(rng.uniform(1.0, 3.0)), float(rng.choice([0.2, 0.05, 0.01, 0.0]))))
    return PosedShape(family, shape, x, z, 1.1 * deep)


def random_profile(rng: np.random.Generator) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Points 0.2–0.7 mm apart over some 4 mm, up and down by up to 0.4 mm: bumps, hollows and near-kinks."""
    x = np.cumsum(rng.uniform(0.2, 0.7, size=10))
    height = rng.uniform(0, 0.4, size=10)
    return tuple((x - x.mean()).tolist()), tuple((height - height.min()).tolist())


def solved(finger: Fingertip, n: int, seed: int) -> Iterator[tuple[PosedShape, IndentationResult]]:
    """n scenes that lie within the patch, each pressed from rest."""
    rng = np.random.default_rng(seed)
    done = 0
    while done < n:
        scene = draw(rng)
        try:
            result = finger.indent(scene.indentor, scene.x_mm, z_mm=scene.z_mm, doi_mm=scene.doi_mm)
        except ModelRangeError:
            continue
        done += 1
        yield scene, result


def touches_an_edge(result: IndentationResult) -> bool:
    """Whether a node is held on a curved or steep part, or there are two regions in the receptor plane."""
    patch, state = result.model.patch, result.state
    at = {X: result.x_mm, Z: result.z_mm}
    place = np.array([[at[axis]] for axis in result.indentor.axes])
    offset = (patch.tangential_mm + state.displacement[:-1])[:, state.active] - place
    steepness = np.hypot.reduce(result.indentor.evaluate(offset).slope)
    return bool((steepness > 0.2).any()) or len(result.contact_regions_mm) > 1


def main() -> None:
    """Print a table by family and the worst scenes."""
    n = int(sys.argv[1]) if len(sys.argv) > 1 else 2000
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    passes: dict[str, list[int]] = defaultdict(list)
    times: dict[str, list[float]] = defaultdict(list)
    worst: dict[str, float] = defaultdict(float)
    missed: Counter[str] = Counter()
    large = edges = 0
    for scene, result in solved(Fingertip.load(ON_ITS_PATCH), n, seed):
        state = result.state
        passes[scene.family].append(state.passes)
        times[scene.family].append(1e3 * result.contact_s)
        worst[scene.family] = max(worst[scene.family], state.residual)
        large += int(state.active.sum() >= 20)
        edges += touches_an_edge(result)
        if state.residual > TARGET_RESIDUAL:
            missed[scene.family] += 1
            print(f"missed: {scene} residual {state.residual:.1e} after {state.passes} passes", file=sys.stderr)
    columns = ("family", "poses", "residual > 1e-10", "worst residual", "passes, median / p99 / max",
               "processor ms, median / p95")  # fmt: skip
    print(f"| {' | '.join(columns)} |")
    print("|---|---|---|---|---|---|")
    for family in FAMILIES:
        p, t = passes[family], times[family]
        if p:
            spent = f"{np.median(p):.0f} / {np.percentile(p, 99):.0f} / {max(p)}"
            took = f"{np.median(t):.0f} / {np.percentile(t, 95):.0f}"
            print(f"| {family} | {len(p)} | {missed[family]} | {worst[family]:.0e} | {spent} | {took} |")
    print(f"\n{n} poses, seed {seed}: {large / n:.0%} with 20 active nodes or more,")
    print(f"{edges / n:.0%} at an edge or in two regions, {sum(missed.values())} missed")


if __name__ == "__main__":
    main()
