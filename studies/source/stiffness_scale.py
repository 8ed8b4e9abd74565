"""The stiffness scale of the default fingertip, to be stored in sim/config.py.

.venv/bin/python -m studies.source.stiffness_scale
"""

from sim.models.fingertip import Fingertip
from sim.units import GWT_N

X_MM, DOI_MM, FORCE_GWT = -1.63, 0.73, 8.0  # Raju (1998): step 1 in this pose stands for this force


def calibrate(finger: Fingertip) -> float:
    """E(epidermis) in MPa for which the finger carries the source's force in the source's scene."""
    return FORCE_GWT * GWT_N / finger.indent("step:1", X_MM, doi_mm=DOI_MM).state.normal_force


if __name__ == "__main__":
    print(f"E_EPIDERMIS_MPA = {calibrate(Fingertip.load()):.6f}")
