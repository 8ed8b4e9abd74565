"""The stiffness scale: the one number that turns pseudo-units into MPa.

Raju (1998) knows ratios of E only. His step 1 at x = −1.63 mm, pressed 0.73 mm deep, stands for a force of
8 gwt; on the default mesh that makes E(epidermis) the number stored here. `python -m sim.calibration` prints it
anew; another geometry or mesh keeps the stored one.
"""

E_EPIDERMIS_MPA = 0.190136


def calibrate() -> float:
    """E(epidermis) in MPa for which the default fingertip carries 8 gwt in the source's scene."""
    from sim.fingertip import Fingertip
    from sim.units import GWT_N

    result = Fingertip.load().indent("step:1", -1.63, doi_mm=0.73)
    return 8.0 * GWT_N / result.state.normal_force


if __name__ == "__main__":
    print(f"E_EPIDERMIS_MPA = {calibrate():.6f}")
