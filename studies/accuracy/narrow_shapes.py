"""Force of narrow shapes: does it rise with depth and change smoothly with the place, and is it that of finer meshes?

    .venv/bin/python -m studies.accuracy.narrow_shapes [PLACES]    # 25 places by default

Each of 30 shapes is pressed to 20 depths at places drawn over two elements, and 1 µm beside each. The tests walk a
few of them on a coarse mesh.
"""

import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from sim.config import FingertipConfig, MeshSpec
from sim.contact.height_map import HeightMap
from sim.contact.indentor import BOTH, Indentor
from sim.contact.measured_profile import MeasuredProfile
from sim.contact.patch import X, Z
from sim.contact.shapes import parse_shape
from sim.errors import ModelRangeError
from sim.models.fingertip import Fingertip
from sim.workers import in_processes

Array = NDArray[np.float64]

DEPTHS_MM = np.linspace(0.02, 0.4, 20)
FALL, JUMP = 1e-6, 0.05
"""Largest fall of force with depth, relative to the largest force, and largest change of it over 1 µm in place."""
ASIDE_MM = 1e-3
ELEMENT_MM = 0.17
SEED = 1


def dots(radius_mm: float, pitch_mm: float = 1.0, rows: int = 1) -> HeightMap:
    """Return raised dots, 0.3 mm high: normal curves of a standard deviation, in rows and columns."""
    half = 0.5 * pitch_mm * (rows - 1) + 3 * radius_mm
    at = np.linspace(-half, half, int(10 * half / radius_mm) + 1)
    centres = pitch_mm * (np.arange(rows) - 0.5 * (rows - 1))
    over = np.exp(-(((at[:, None] - centres) / radius_mm) ** 2) / 2)
    name = f"dots of {radius_mm:g}" + (f", pitch {pitch_mm:g}" if rows > 1 else "")
    return HeightMap.from_arrays(
        at, at, 0.3 * np.einsum("zi,xj->zxij", over, over).max(axis=(2, 3)), raised="high", name=name
    )


def peak(half_mm: float, *, linear: bool) -> Indentor:
    """Return a ridge of 0.3 mm on a base of 1 mm, with straight or curved flanks."""
    x = (-0.5, -half_mm, 0.0, half_mm, 0.5)
    name = f"{'peak' if linear else 'bump'} of {half_mm:g}"
    return Indentor.along(MeasuredProfile(name, x, (0.4, 0.3, 0.0, 0.3, 0.4), linear=linear))


ROUND: tuple[str, ...] = tuple(f"flat:{r:g}" for r in (0.1, 0.13, 0.167, 0.25, 0.5))
ROUND += tuple(f"cone:{angle}" for angle in (5, 20, 45, 60, 75)) + tuple(f"sphere:{r:g}" for r in (0.25, 0.4, 1))
PRISMATIC: tuple[str, ...] = (
    "wedge:5",
    "wedge:45",
    "wedge:20,across",
    "wedge:45,turn_deg=30",
    "bar:0.2",
    "bar:0.5,turn_deg=30",
)
PRISMATIC += ("line", "grating:0.15,0.4", "cylinder:0.5", "step:1")


@cache
def shapes() -> dict[str, Indentor]:
    """Return the shapes by name."""
    own: list[Indentor] = [dots(0.1), dots(0.18), dots(0.25), dots(0.1, 0.5, 3), dots(0.2, 0.8, 3)]
    own += [peak(0.05, linear=True), peak(0.15, linear=False)]
    return {name: parse_shape(name) for name in (*ROUND, *PRISMATIC)} | {shape.name: shape for shape in own}


@dataclass(frozen=True)
class Walk:
    """Forces (gwt) of a shape at places and depths, and beside them; without places, why it was refused."""

    shape: str
    force: Array  # (places, depths)
    beside: Array
    residual: float
    refused: str = ""

    @property
    def fall(self) -> float:
        """Largest fall of force with depth, relative to the largest force at the place."""
        both = np.concatenate([self.force, self.beside])
        fallen = -np.diff(both, axis=1, prepend=0.0)
        return float((fallen.max(axis=1) / both.max(axis=1)).max())

    @property
    def jump(self) -> float:
        """Largest change of force over 1 µm in place, relative to the force or a hundredth of the largest."""
        scale = np.maximum(self.force, self.force.max() / 100)
        return float((np.abs(self.beside - self.force) / scale).max())

    @property
    def scatter(self) -> Array:
        """(depths,) largest deviation of force from its mean over places."""
        mean = self.force.mean(axis=0)
        return np.asarray(np.abs(self.force / mean - 1).max(axis=0))


def places(count: int, width_mm: float = 2 * ELEMENT_MM, seed: int = SEED) -> list[tuple[float, float]]:
    """Return places drawn over a square about the middle of the pad, as x and distance from the receptor plane."""
    return [(float(x), float(z)) for x, z in np.random.default_rng(seed).uniform(-0.5, 0.5, (count, 2)) * width_mm]


def walk(finger: Fingertip, shape: Indentor, at: Sequence[tuple[float, float]], depths_mm: Array) -> Walk:
    """Press a shape at places, and 1 µm beside each, to depths."""
    found, residual = [], 0.0
    plane_mm = finger.config.receptor_plane_mm
    aside = (ASIDE_MM, 0.0) if X in shape.placed_by else (0.0, ASIDE_MM)
    for x, z in (place for one in at for place in (one, tuple(np.add(one, aside)))):
        pressed = finger.keeping_ways()
        at_x, at_z = x if X in shape.placed_by else 0.0, plane_mm + z if Z in shape.placed_by else None
        try:
            results = [pressed.indent(shape, at_x, z_mm=at_z, doi_mm=float(doi)) for doi in depths_mm]
        except ModelRangeError as error:
            if error.code != "narrower_than_mesh":
                raise
            nothing = np.zeros((0, len(depths_mm)))
            return Walk(shape.name, nothing, nothing, 0.0, str(error))
        found.append([result.force_gwt for result in results])
        residual = max(residual, *(result.state.residual for result in results))
    forces = np.array(found)
    return Walk(shape.name, forces[::2], forces[1::2], residual)


def walked(task: tuple[str, int]) -> list[str]:
    """Return the row of the table of a shape, walked at some places on the default mesh."""
    shape, count = shapes()[task[0]], task[1]
    found = walk(Fingertip.load(slopes=shape.axes), shape, places(count), DEPTHS_MM)
    if found.refused:
        return [found.shape, "refused", "", "", "", ""]
    scatter, verdict = found.scatter, "yes" if found.fall <= FALL and found.jump <= JUMP else "**no**"
    spread = [f"{100 * scatter[k]:.1f}" for k in (2, 9)]  # 0.06 and 0.2 mm
    return [found.shape, verdict, f"{found.fall:.0e}" if found.fall > 0 else "0", f"{100 * found.jump:.1f}", *spread]


CONVERGED = (
    "flat:0.13",
    "flat:0.167",
    "flat:0.25",
    "cone:60",
    "cone:75",
    "sphere:0.25",
    "sphere:0.4",
    "dots of 0.25",
)
"""Shapes pressed into finer meshes."""
_FEW, _DEEP_MM = 4, np.array([0.1, 0.2])


def own_mesh(spacing_mm: float) -> FingertipConfig:
    """Return the finger on cubes of a size about the middle of the pad, which grow fast beside it."""
    mesh = MeshSpec(
        spacing_mm=spacing_mm,
        axial_spacing_mm=spacing_mm,
        round_patch_mm=0.45,
        epidermis_elements=round(0.4 / spacing_mm),
        dermis_spacing_mm=0.1,
        dermis_fine_depth_mm=0.8,
        growth=1.4,
        near_spacing_mm=0.6,
        near_width_mm=1.0,
        far_spacing_mm=2.0,
    )
    return FingertipConfig(mesh=mesh)


def converged() -> Iterable[list[str]]:
    """Yield the row of each shape: mean forces at four places and two depths on three meshes."""
    fingers = [Fingertip.load(config, slopes=BOTH) for config in (FingertipConfig(), own_mesh(0.1), own_mesh(0.05))]
    for name in CONVERGED:
        means = [walk(one, shapes()[name], places(_FEW, ELEMENT_MM), _DEEP_MM).force.mean(axis=0) for one in fingers]
        forces = [f"{mean[k]:.3f}" for k in range(2) for mean in means]
        yield [name, *forces, f"{100 * (means[0][1] / means[-1][1] - 1):+.0f}"]


def printed(rows: Iterable[Sequence[str]], head: Sequence[str]) -> None:
    """Print a Markdown table."""
    for row in (head, ["---"] * len(head), *rows):
        print(f"| {' | '.join(row)} |", flush=True)
    print()


def main(count: int = 25) -> None:
    """Print the tables."""
    head = ["shape", "rises, is continuous", "fall / peak", "change over 1 µm (%)", "scatter at 0.06 mm (%)"]
    printed(in_processes(walked, [(name, count) for name in shapes()], 2), [*head, "scatter at 0.2 mm (%)"])
    meshes = [f"{mm:g} mm, elements of {h:g} (gwt)" for mm in _DEEP_MM for h in (0.17, 0.1, 0.05)]
    printed(converged(), ["shape", *meshes, "0.17 against 0.05 (%)"])


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
