"""Strain under the skin at the deepest press of a run."""

import numpy as np

from rig.compare.stimuli import deepest_map
from rig.data import Run
from rig.report.page_parts import PageFigure
from rig.report.profile_figures import strain_maps
from sim.models.fingertip import Fingertip


def strain_figures(run: Run, finger: Fingertip) -> list[PageFigure]:
    """Return the figure; none for a run without a finished press. One factorization of the whole mesh."""
    strain = deepest_map(run, finger)
    if strain is None:
        return []
    deepest = float(np.max(strain.stimulus.doi_mm))
    return [
        PageFigure(
            "Strain under the skin",
            strain_maps([strain]),
            f"The deformed receptor plane at the deepest press ({strain.stimulus.title}, DOI {deepest:.3f} mm): one "
            "value per element, not smoothed. White circles: receptors. The highest 3 % of the elements share the "
            "top color.",
        )
    ]
