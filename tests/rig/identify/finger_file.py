"""The file of a finger that was identified, for tests: no such finger was."""

import numpy as np

from rig.plan.finger_file import Band, Draw, FingerFile, IdentifiedFinger, Place, Posterior
from sim.config import FingertipConfig, Tissue
from tests.sim.coarse_mesh import coarse_mesh

MESH = coarse_mesh(0.5, 0.7, patch_x_mm=2.3, patch_z_mm=2.3)
SERIES = ((0.2, 0.07), (0.2, 1.4))


def identified_file(
    *, spread: float = 0.05, relaxation: tuple[tuple[float, float], ...] = (), stiffness: float = 1.0, draws: int = 8
) -> FingerFile:
    """On a coarse mesh; ln of stiffness and of e_fat spread so much, one against the other."""
    z = np.linspace(-1.4, 1.4, draws)
    likely = tuple(
        Draw(
            stiffness=stiffness * float(np.exp(spread * s)),
            e_dermis=0.1,
            e_fat=0.1 * float(np.exp(-spread * s)),
            relaxation=relaxation,
        )
        for s in z
    )
    return FingerFile(
        finger=FingertipConfig(mesh=MESH, tissue=Tissue(stiffness=stiffness)),
        relaxation=relaxation,
        identified=IdentifiedFinger(
            date="2026-11-23",
            version="0.2.0",
            bench="virtual",
            runs=("one",),
            journals_sha256=("0" * 64,),
            presses=8,
            not_learned=("the dermis: it moves no force that was asked for",),
            place=Place(
                x_mm=0.1, x_sd_mm=0.02, height_mm=-0.05, height_sd_mm=0.01, cell_zero_gwt=0.0, cell_zero_sd_gwt=0.01
            ),
            posterior=Posterior(
                names=("ln_stiffness", "ln_e_fat", "x_mm"),
                mean=(float(np.log(stiffness)), float(np.log(0.1)), 0.1),
                covariance=(
                    (spread**2, -(spread**2), 0.0),
                    (-(spread**2), spread**2, 0.0),
                    (0.0, 0.0, 4e-4),
                ),
            ),
            draw=likely,
            band=Band(model_error=0.02),
        ),
    )
