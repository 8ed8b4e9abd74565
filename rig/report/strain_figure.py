"""Strain under the skin at the deepest press of a run."""

import numpy as np

from rig.compare.stimuli import deepest_map
from rig.data import Run
from rig.report.plot import Plot
from rig.report.profile_figures import strain_maps
from sim.models.fingertip import Fingertip


def strain_figures(run: Run, finger: Fingertip) -> list[Plot]:
    """Return the figure; none for a run without a finished press. One factorization of the whole mesh."""
    strain = deepest_map(run, finger)
    if strain is None:
        return []
    deepest = float(np.max(strain.stimulus.doi_mm))
    press = f"{strain.stimulus.title}, DOI {deepest:.3f} mm"
    where = f" at the deepest press ({press}): one value per element, not smoothed."
    return [strain_maps([strain], "Strain under the skin", where)]
