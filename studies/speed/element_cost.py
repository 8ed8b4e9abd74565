"""What a matrix costs by element, in CPU seconds: what a busy machine does to times does little to these.

OMP_NUM_THREADS=1 .venv/bin/python -m studies.speed.element_cost    # about a minute
"""

import time
from collections.abc import Callable
from functools import partial

import scipy.sparse as sp

from sim.benchmark import QUADRATIC, SCENE_PATCH, nested
from sim.config import FingertipConfig, MeshSpec
from sim.fem.elements import Ints
from sim.fem.mkl_condensation import PardisoFactor
from sim.finger.mesh import build_mesh
from sim.finger.surface import FingertipSurface
from sim.models.condensed import discretise

MESHES = {
    "B-bar, n = 2": nested(2),
    "incompatible modes, n = 2": nested(2, element="incompatible"),
    "quadratic, elements of n = 1": nested(1, element="quadratic"),
    "quadratic, 0.34 mm": QUADRATIC,
    "quadratic, 0.34 mm, two in the epidermis": QUADRATIC.model_copy(update={"epidermis_elements": 2}),
    "B-bar, default": MeshSpec(),
    "incompatible modes, default": MeshSpec(element="incompatible"),
    "B-bar, default, the study's patch": MeshSpec.model_validate(SCENE_PATCH),
}


def cpu_s(action: Callable[[], object]) -> float:
    """CPU seconds of one call."""
    start = time.process_time()
    action()
    return time.process_time() - start


def _factored(upper: sp.csr_array, kept: Ints) -> None:
    PardisoFactor(upper, kept).close()


def main() -> None:
    """Print the table."""
    print("| element, mesh | nodes | assembly (s) | condensation (s) | factor alone (s) |\n|---|---|---|---|---|")
    for name, spec in MESHES.items():
        config = FingertipConfig(mesh=spec)
        mesh = build_mesh(config, FingertipSurface.fit(config.geometry))
        problem = discretise(config, mesh)
        seconds = (
            cpu_s(partial(discretise, config, mesh)),
            cpu_s(partial(_factored, problem.upper, problem.kept)),
            cpu_s(partial(_factored, problem.upper, problem.kept[:1])),
        )
        print(f"| {name} | {len(mesh.nodes)} | {' | '.join(f'{s:.1f}' for s in seconds)} |", flush=True)


if __name__ == "__main__":
    main()
