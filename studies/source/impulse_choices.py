"""What the source leaves open about impulse responses, and how far each choice moves them.

.venv/bin/python -m studies.source.impulse_choices
"""

import numpy as np
from numpy.typing import NDArray

from sim.coding.operators import impulse_responses
from sim.coding.section import SampledSection, Sampling, sampled_section
from sim.config import FingertipConfig, MeshSpec

Array = NDArray[np.float64]
_WITHIN = 41  # places over one sample, for a pressure that is even over it


def main() -> None:
    """Print relative L2 of h, g and f against the default's, one choice a row."""
    section = sampled_section(FingertipConfig(), Sampling())
    default = impulse_responses(section).strain
    print("| instead | h | g | f |\n|---|---|---|---|")
    for name, other in _others(section).items():
        moved = np.linalg.norm(other - default, axis=1) / np.linalg.norm(default, axis=1)
        print(f"| {name} | {' | '.join(f'{100 * v:.1f} %' for v in moved)} |")


def _others(section: SampledSection) -> dict[str, Array]:
    spacing = section.sampling.spacing_mm
    over = spacing * (np.arange(_WITHIN) + 0.5 - _WITHIN / 2) / _WITHIN
    even = spacing * section.under_loads(over)[..., 0].mean(axis=-1)
    shallow, deep = (_responses(Sampling(depth_mm=depth)) for depth in (0.70, 0.82))
    return {
        "the load even over one sample": even,
        "the load along −y": spacing * _straight_down(section),
        "receptors 0.70 mm deep": shallow,
        "receptors 0.82 mm deep": deep,
        "nodes 0.1 mm apart (fine)": _responses(Sampling(), MeshSpec(level="fine")),
        "nodes 0.05 mm apart": _responses(Sampling(), MeshSpec(level="fine", spacing_mm=0.05, epidermis_elements=6)),
    }


def _responses(sampling: Sampling, mesh: MeshSpec | None = None) -> Array:
    return impulse_responses(sampled_section(FingertipConfig(mesh=mesh or MeshSpec()), sampling)).strain


def _straight_down(section: SampledSection) -> Array:
    across, up = section.line.normals(section.line.angles(0.0))[0]
    normal, tangent = section.under_loads(0.0)[:, :, 0].T
    return np.asarray((up * normal + across * tangent).T)


if __name__ == "__main__":
    main()
