"""Results and costs of candidate models in benchmark scenes."""

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cache, partial
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack
from threadpoolctl import threadpool_limits

from rig_shared.outputs import Name, Output, Ratio, listed
from sim.config import Contact, FingertipConfig, MeshSpec
from sim.contact.indentor import Prismatic
from sim.fem.dissection import DissectionFactor
from sim.finger.mesh import build_mesh
from sim.finger.surface import FingertipSurface
from sim.models.catalogue import ModelName, load
from sim.models.condensed import discretise
from sim.models.full_mesh import CONTACT_STIFFNESS_MPA_PER_MM, MeshedFinger, write_contact_deck
from sim.models.result import IndentationResult
from sim.workers import in_processes

# --- candidates ---

SCENE_PATCH = {"patch_x_mm": 2.4, "patch_z_mm": 2.3}
"""Half-widths of the patch (mm), enough for every scene."""

_TO_NAIL_MM = 6.893 - 5.0 - 1e-6
_ROWS = {1: 3, 2: 5, 3: 7, 4: 9, 5: 9, 8: 9}

LEVELS = ("coarse", "default", "fine")
"""Mesh levels from cheap to expensive."""
ElementName = Literal["analytic", "bbar", "full", "incompatible", "quadratic"]
Level = Annotated[str, listed(LEVELS)]

SHARES = (0.65, 1.0)
"""Fractions of the default patch's half-widths; few of them, so that scenes share models."""


@dataclass(frozen=True)
class Candidate:
    """Model with its element and mesh size."""

    model: ModelName
    refinement: str
    mesh: MeshSpec = field(default_factory=MeshSpec)

    @property
    def element(self) -> ElementName:
        """Element of the mesh; "analytic" for a half-space."""
        return "analytic" if self.model == "halfspace" else self.mesh.element

    @property
    def config(self) -> FingertipConfig:
        """The default finger on this mesh."""
        return FingertipConfig(mesh=self.mesh)


def of_level(model: ModelName, level: str, share: float) -> Candidate:
    """Return a level's mesh on a fraction of the default patch."""
    usual = MeshSpec()
    sizes = {name: share * getattr(usual, name) for name in ("patch_x_mm", "patch_z_mm", "round_patch_mm")}
    return Candidate(model, level, MeshSpec.model_validate({"level": level, **sizes}))


def nested(n: int, **other: float | str | bool) -> MeshSpec:
    """Return a mesh of the uniformly refined family, with n elements through the epidermis.

    Lateral spacing and depths are those elements' size, axial spacing about twice that: _ROWS[n] rows of nodes from
    the receptor plane to the nail's edge, so that the skin is fixed at the same points on every mesh.
    """
    spacing = 0.4 / n
    evenly = {
        "spacing_mm": spacing,
        "axial_spacing_mm": _TO_NAIL_MM / _ROWS[n],
        "epidermis_elements": n,
        "dermis_spacing_mm": spacing,
        "growth": 1.2 ** (2 / n),
        "far_growth": 1.5 ** (2 / n),
        "near_spacing_mm": 1 / n,
        "far_spacing_mm": 3 / n,
    }
    return MeshSpec.model_validate({**SCENE_PATCH, **evenly, **other})


def coarse(spacing_mm: float, element: str = "bbar") -> MeshSpec:
    """Return a mesh that takes seconds: lateral spacing, twice that along the finger, and the default depths."""
    values = {"spacing_mm": spacing_mm, "axial_spacing_mm": 2 * spacing_mm, "element": element}
    return MeshSpec.model_validate({**SCENE_PATCH, **values})


QUADRATIC = MeshSpec.model_validate(
    {
        **SCENE_PATCH,
        "element": "quadratic",
        "spacing_mm": 0.34,
        "epidermis_elements": 1,
        "dermis_spacing_mm": 0.4,
        "growth": 1.2**2,
        "far_growth": 1.5**2,
        "near_spacing_mm": 1.0,
        "far_spacing_mm": 3.0,
    }
)
"""Elements of twice the default size, with nodes as far apart as the default's."""


# --- scenes ---

OFFSET_RANGE_MM = 0.17
"""Positions spread over one element of the default mesh, so that no result depends on where a node lies."""


@dataclass(frozen=True)
class BenchmarkScene:
    """One indentation to a depth, in a family of shapes with similar errors."""

    family: str  # "smooth", "bar" or "step"
    shape: str
    x_mm: float
    doi_mm: float

    @property
    def name(self) -> str:
        """Name in tables."""
        return f"{self.shape} at {self.x_mm:g}, DOI {self.doi_mm:g}"


def _offset(family: str, shape: str, x_mm: float, doi_mm: float, n: int) -> list[BenchmarkScene]:
    offsets = np.arange(n) * OFFSET_RANGE_MM / n
    return [BenchmarkScene(family, shape, round(x_mm + float(offset), 4), doi_mm) for offset in offsets]


SCENES = (
    *_offset("smooth", "cylinder:9", 0.0, 0.4, 2),
    *_offset("smooth", "cylinder:9", 0.0, 0.67, 2),
    *_offset("smooth", "cylinder:3", 0.0, 0.67, 2),
    *_offset("smooth", "step:5", -1.63, 0.73, 2),
    *_offset("bar", "bar:3.0", 0.0, 0.67, 4),
    *_offset("bar", "bar:1.5", 0.0, 0.67, 4),
    *_offset("step", "step:1", -1.63, 0.73, 4),
)

FAMILIES = ("smooth", "bar", "step")

QUICK_SCENES = tuple(scene for scene in SCENES if scene.x_mm in (0.0, -1.63))
"""First position of each schedule."""


Array = NDArray[np.float64]

QUANTITIES = ("force", "width", "sed", "ep1")
Quantity = Annotated[str, listed(QUANTITIES)]
_FEW = 5  # repetitions of the Cholesky timing, of which the fastest counts


@dataclass(frozen=True)
class SceneResult:
    """Result of one scene."""

    force_mm2: float  # force / E(epidermis), on which no error depends; for a section in mm
    width_mm: float
    sed: tuple[float, ...]
    ep1: tuple[float, ...]
    residual: float
    passes: int
    seconds: float
    limit_s: float  # one dense Cholesky factorization of the order of the points in contact

    def value(self, quantity: str) -> Array:
        """Return (k,) the quantity: one number, or one for each receptor."""
        values = {"force": (self.force_mm2,), "width": (self.width_mm,), "sed": self.sed, "ep1": self.ep1}
        return np.array(values[quantity])


@dataclass(frozen=True)
class Measured:
    """Candidate with its results and costs."""

    candidate: Candidate
    nodes: int
    patch_nodes: int
    build_s: float  # without the cache
    timing_s: dict[str, float]
    memory_mb: float  # peak of a dedicated process
    factor_s: float | None  # one sparse factorization of the same matrix, without its Schur complement
    answers: dict[BenchmarkScene, SceneResult]

    @property
    def contact_s(self) -> float:
        """Median time of one indentation (s)."""
        return float(np.median([answer.seconds for answer in self.answers.values()]))

    @property
    def limit_s(self) -> float:
        """Median lower limit of an indentation's time (s)."""
        return float(np.median([answer.limit_s for answer in self.answers.values()]))


def measure(candidates: Iterable[Candidate], scenes: Sequence[BenchmarkScene]) -> Iterator[Measured]:
    """Measure candidates one after the other, each in a separate process."""
    measured = partial(_measured, scenes=tuple(scenes))
    for candidate in candidates:
        yield from in_processes(measured, [candidate], 1)


def _measured(candidate: Candidate, scenes: tuple[BenchmarkScene, ...]) -> Measured:
    start = time.perf_counter()
    finger = load(candidate.model, candidate.config, cached=False)
    model = finger.model
    build_s = time.perf_counter() - start
    answers = {scene: answered(finger.indent(scene.shape, scene.x_mm, doi_mm=scene.doi_mm)) for scene in scenes}
    memory_mb = peak_memory_mb()
    factor_s = sparse_factor_s(candidate) if candidate.model == "finger" else None
    return Measured(candidate, model.nodes, len(model.patch), build_s, model.timing_s, memory_mb, factor_s, answers)


def answered(result: IndentationResult) -> SceneResult:
    measures = result.receptor_measures
    return SceneResult(
        force_mm2=result.state.normal_force,
        width_mm=float(sum(right - left for left, right in result.contact_regions_mm)),
        sed=tuple(measures["sed"].tolist()),
        ep1=tuple(measures["ep1"].tolist()),
        residual=result.state.residual,
        passes=result.state.passes,
        seconds=result.contact_s,
        limit_s=dense_cholesky_s(max(1, len(result.state.held))),
    )


def peak_memory_mb() -> float:
    """Return this process's peak memory; on Linux from the kernel, since getrusage starts with the parent's peak."""
    status = Path("/proc/self/status")
    if status.exists():
        lines = dict(line.split(":", 1) for line in status.read_text(encoding="ascii").splitlines())
        return float(lines["VmHWM"].split()[0]) / 1024
    return _peak_bytes() / 1024**2


if sys.platform == "win32":
    import ctypes
    from ctypes import wintypes

    class _MemoryCounters(ctypes.Structure):
        """PROCESS_MEMORY_COUNTERS of psapi.h."""

        _fields_ = (
            *((name, wintypes.DWORD) for name in ("cb", "page_faults")),
            *((f"size_{n}", ctypes.c_size_t) for n in range(8)),  # the first is PeakWorkingSetSize
        )

    def _peak_bytes() -> int:
        kernel, counters = ctypes.WinDLL("kernel32"), _MemoryCounters()
        kernel.GetCurrentProcess.restype = wintypes.HANDLE
        kernel.K32GetProcessMemoryInfo.argtypes = (wintypes.HANDLE, ctypes.c_void_p, wintypes.DWORD)
        kernel.K32GetProcessMemoryInfo(kernel.GetCurrentProcess(), ctypes.byref(counters), ctypes.sizeof(counters))
        return int(counters.size_0)

else:
    import resource

    def _peak_bytes() -> int:
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        return peak if sys.platform == "darwin" else 1024 * peak


def sparse_factor_s(candidate: Candidate) -> float:
    """Return the time of one factorization of the finger's matrix, condensed onto a single unknown."""
    config = candidate.config
    problem = discretise(config, build_mesh(config, FingertipSurface.fit(config.geometry)))
    start = time.perf_counter()
    DissectionFactor(problem.upper, problem.kept[:1], problem.places)
    return time.perf_counter() - start


def dense_cholesky_s(order: int) -> float:
    """Return the time of one dense Cholesky factorization by LAPACK on one thread."""
    rows = np.random.default_rng(0).standard_normal((order, order + 8))
    spd = rows @ rows.T
    times = []
    with threadpool_limits(1):
        for _ in range(_FEW):
            start = time.perf_counter()
            lapack.dpotrf(spd, lower=1, clean=0)
            times.append(time.perf_counter() - start)
    return min(times)


# --- reference ---
#
# `studies/accuracy/reference_levels.py` makes the reference: results of a fine mesh with error bars.

Bars = Mapping[str, Mapping[str, float]]

FILE = "reference_answers.json"


@dataclass(frozen=True)
class ReferenceValues:
    """Values (k,) for each scene and quantity, and relative error bars for each family and quantity."""

    values: Mapping[BenchmarkScene, Mapping[str, Array]]
    bars: Bars
    provenance: Mapping[str, Any]

    def error(self, scene: BenchmarkScene, quantity: str, answer: SceneResult) -> float:
        """Return the largest deviation / the largest value of the quantity, over all receptors."""
        value = self.values[scene][quantity]
        return float(np.abs(answer.value(quantity) - value).max() / np.abs(value).max())

    def largest_errors(self, answers: Mapping[BenchmarkScene, SceneResult]) -> dict[str, dict[str, float]]:
        """Return the largest errors by family and quantity."""
        return {
            family: {
                quantity: max(
                    self.error(scene, quantity, a) for scene, a in answers.items() if scene.family == family
                )
                for quantity in QUANTITIES
            }
            for family in FAMILIES
        }


def from_levels(
    coarse: Mapping[BenchmarkScene, SceneResult], fine: Mapping[BenchmarkScene, SceneResult], about: Mapping[str, Any]
) -> ReferenceValues:
    """Return the finer of two levels, with the largest changes from the coarser one as error bars.

    There is no extrapolation: under sharp shapes the changes from level to level have no single order.
    """
    values = {scene: {quantity: answer.value(quantity) for quantity in QUANTITIES} for scene, answer in fine.items()}
    bars = ReferenceValues(values, {}, about).largest_errors(coarse)
    return ReferenceValues(values, bars, about)


def stored() -> ReferenceValues:
    """Return the bundled reference."""
    return _read((files("sim") / "data" / FILE).read_text(encoding="utf-8"))


@cache
def _read(text: str) -> ReferenceValues:
    content = json.loads(text)
    values = {
        BenchmarkScene(**row["scene"]): {quantity: np.array(row[quantity]) for quantity in QUANTITIES}
        for row in content["scenes"]
    }
    return ReferenceValues(values, content["bars"], content["provenance"])


def as_json(reference: ReferenceValues) -> str:
    """Return the JSON text that `stored` reads."""
    rows = [
        {"scene": asdict(scene), **{quantity: value.tolist() for quantity, value in values.items()}}
        for scene, values in reference.values.items()
    ]
    content = {"provenance": reference.provenance, "bars": reference.bars, "scenes": rows}
    return json.dumps(content, indent=1) + "\n"


# --- rows ---

PER_LENGTH = frozenset({"section"})
"""Models whose force is per unit length and has no error against a finger's force."""

QUICK = (
    Candidate("halfspace", "0.28 mm", coarse(0.28)),
    Candidate("section", "0.28 mm", coarse(0.28)),
    Candidate("section", "n = 3", nested(3)),
    Candidate("finger", "0.28 mm", coarse(0.28)),
    Candidate("finger", "n = 2", nested(2)),
    Candidate("finger", "0.28 mm", coarse(0.28, "full")),
    Candidate("finger", "0.28 mm", coarse(0.28, "incompatible")),
)
WHOLE = (
    *QUICK,
    Candidate("finger", "n = 2", nested(2, element="full")),
    Candidate("finger", "n = 2", nested(2, element="incompatible")),
    Candidate("finger", "n = 1", nested(1, element="quadratic")),
    Candidate("halfspace", "default"),
    Candidate("section", "default"),
    Candidate("section", "n = 5", nested(5)),
    Candidate("finger", "n = 3", nested(3)),
    Candidate("finger", "n = 3", nested(3, element="full")),
    Candidate("finger", "0.34 mm", QUADRATIC),
    Candidate("finger", "0.34 mm, two in the epidermis", QUADRATIC.model_copy(update={"epidermis_elements": 2})),
    Candidate("finger", "default"),
    Candidate("finger", "default", MeshSpec(element="full")),
    Candidate("finger", "default", MeshSpec(element="incompatible")),
    Candidate("finger", "default, axial 0.17", MeshSpec(axial_spacing_mm=0.17)),
    Candidate("finger", "fine", MeshSpec(level="fine")),
)


class BenchmarkRowJson(Output):
    """Error and cost of a model. build_s: of the model and its first answer."""

    model: ModelName
    element: ElementName
    refinement: Name
    nodes: int
    scene: Name
    family: Annotated[str, listed(FAMILIES)]
    quantity: Quantity
    error: Ratio
    total_s: float
    contact_s: float
    memory_mb: float


def rows(measured: Iterable[Measured], reference: ReferenceValues) -> Iterator[BenchmarkRowJson]:
    """Yield the rows of `rig bench --json`, one for each scene and quantity; errors are relative."""
    for found in measured:
        for scene, answer in found.answers.items():
            for quantity in QUANTITIES:
                if quantity == "force" and found.candidate.model in PER_LENGTH:
                    continue
                yield {
                    "model": found.candidate.model,
                    "element": found.candidate.element,
                    "refinement": found.candidate.refinement,
                    "nodes": found.nodes,
                    "scene": scene.name,
                    "family": scene.family,
                    "quantity": quantity,
                    "error": reference.error(scene, quantity, answer),
                    "total_s": found.build_s + answer.seconds,
                    "contact_s": answer.seconds,
                    "memory_mb": found.memory_mb,
                }


# --- calculix ---
#
# Debian: apt-get install calculix-ccx. The deck and its settings are `sim/models/full_mesh.py`'s.

CONFIG = FingertipConfig(
    contact=Contact(between_nodes=False),
    mesh=MeshSpec(
        spacing_mm=0.5, axial_spacing_mm=0.5, element="full", epidermis_elements=1, dermis_spacing_mm=0.4, growth=1.5
    ),
)
"""Settings of the CalculiX comparison: C3D8 is fully integrated, with contact at nodes. Coarse, to keep its job
short."""

SHAPE, DOI_MM = "bar:3.0", 0.8
_REPEATS = 20
_LONGEST_S = 3600


@dataclass(frozen=True)
class CalculixComparison:
    """Forces (N) and CPU times (s) of CalculiX and this solver."""

    scene: str
    nodes: int
    stiffness_mpa_per_mm: float
    force_n: float
    cpu_s: float
    our_force_n: float
    our_build_s: float
    our_cpu_s: float


def available() -> bool:
    """Return whether CalculiX is installed, on a system that reports the CPU time of other processes."""
    return sys.platform != "win32" and shutil.which("ccx") is not None


def compare(config: FingertipConfig = CONFIG, shape: str = SHAPE, doi_mm: float = DOI_MM) -> CalculixComparison:
    """Solve one scene, from rest at x = 0, with both; seconds on the coarse mesh."""
    finger = load("finger", config, cached=False)
    result = finger.indent(shape, 0.0, doi_mm=doi_mm)
    start = time.process_time()
    for _ in range(_REPEATS):
        finger.indent(shape, 0.0, doi_mm=doi_mm)
    our_cpu_s = (time.process_time() - start) / _REPEATS
    meshed = MeshedFinger(config, build_mesh(config, finger.surface), finger.e_epidermis_mpa)
    with tempfile.TemporaryDirectory() as folder:
        deck = Path(folder) / "contact.inp"
        assert isinstance(result.indentor, Prismatic)
        write_contact_deck(deck, meshed, result.indentor.profile, 0.0, result.touch_height_mm, doi_mm)
        force_n, cpu_s = _job(deck)
    return CalculixComparison(
        f"{shape}, DOI {doi_mm} mm", finger.model.nodes, CONTACT_STIFFNESS_MPA_PER_MM, force_n, cpu_s,
        result.force_n, finger.build_s, our_cpu_s,
    )  # fmt: skip


def _job(deck: Path) -> tuple[float, float]:
    before = os.times()
    command = ["ccx", "-i", deck.stem]
    subprocess.run(command, cwd=deck.parent, capture_output=True, timeout=_LONGEST_S, check=True)
    after = os.times()
    printed = deck.with_suffix(".dat").read_text()
    total = re.findall(r"total force.*?\n\s*\n\s*(\S+)\s+(\S+)\s+(\S+)", printed)[-1]
    cpu_s = after.children_user + after.children_system - before.children_user - before.children_system
    return -float(total[1]), cpu_s


# --- reference computation ---
#
# Times of different machines and days are relative to a fixed computation that resembles condensing and pressing a
# finger and is independent of this project: a Cholesky factorization and triangular solves by LAPACK on one thread,
# about 0.3 s on two cores at 2.6 GHz.

ORDER, RIGHT_SIDES, SEED = 2048, 768, 16
_ROUNDS = 3


def reference_s() -> float:
    """Return the processor time of the reference computation on this machine (s), the shortest of a few rounds."""
    rng = np.random.default_rng(SEED)
    rows = rng.standard_normal((ORDER, ORDER))
    matrix = np.asfortranarray(rows @ rows.T + ORDER * np.eye(ORDER))
    right = np.asfortranarray(rng.standard_normal((ORDER, RIGHT_SIDES)))
    times = []
    with threadpool_limits(1):
        for _ in range(_ROUNDS):
            began = time.process_time()
            factor, _info = lapack.dpotrf(matrix, lower=1, clean=0)
            forth, _info = lapack.dtrtrs(factor, right, lower=1)
            back, info = lapack.dtrtrs(factor, forth, lower=1, trans=1)
            times.append(time.process_time() - began)
    off = float(np.abs(matrix @ back - right).max())
    if info or not off < 1e-9:
        raise ArithmeticError(f"the reference computation differs by {off:.1e} from its stored result")
    return min(times)
