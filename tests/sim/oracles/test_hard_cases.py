"""Unlike layers, long flat elements."""

from functools import cache

import numpy as np
import pytest

from studies.verification.contrast import condensed as solved
from studies.verification.layer import Layer, compliance, layers_compliance, one_layer_compliance

condensed = cache(solved)  # the same blocks serve several tests


@pytest.mark.parametrize("ratio", [1e3, 1e4, 1e6, 1e8])
def test_condensation_loses_no_precision_with_stiff_bone(ratio: float) -> None:
    # Measured 1e-14 in both, whatever the ratio: bone is held, its displacement small where its stiffness is large.
    answer = condensed(ratio, "bone")
    assert answer.imbalance < 1e-12
    assert answer.mismatch < 1e-12


def test_elastic_bone_converges_to_rigid_bone_with_stiffness() -> None:
    # What an elastic bone adds to the displacement falls as 1 / ratio: 0.45 / ratio of the largest.
    rigid = condensed(1e12, "bone").displacement
    added = [np.abs(condensed(r, "bone").displacement - rigid).max() for r in (1e3, 1e4, 1e6)]
    assert added[0] / added[1] == pytest.approx(10, rel=0.01)
    assert added[1] / added[2] == pytest.approx(100, rel=0.01)


@pytest.mark.parametrize("ratio", [1e3, 1e4, 1e6, 1e8])
def test_condensation_loses_the_digits_of_the_stiffness_ratio_with_stiff_skin(ratio: float) -> None:
    # K·u cancels to f among terms `ratio` times as large: measured 1.2 ratio ε · 5; ten times that is allowed. The
    # contact's residual of 1e-8 therefore holds up to ratios of about 1e6; the finger's epidermis is 10.
    answer = condensed(ratio, "skin")
    assert answer.imbalance < 50 * ratio * np.finfo(float).eps
    assert answer.mismatch < 50 * ratio * np.finfo(float).eps


@pytest.mark.parametrize("poisson", [0.48, 0.4999])
@pytest.mark.parametrize("aspect", [10, 50])
def test_flat_elements_in_a_squeezed_layer_stay_within_half_a_percent(aspect: int, poisson: float) -> None:
    # A layer of 16 rows, each element `aspect` times as long as high, 40 to a wavelength: the tissue is squeezed out
    # sideways, where shear and volume would lock. Measured at most 0.3 %, of which (2π/40)²/12 = 0.2 % is the wave.
    layer, length = Layer(1.0, 1.0, 16), aspect / 16
    k = 2 * np.pi / (40 * length)
    exact = one_layer_compliance(k, layer, poisson)
    assert compliance(k, (layer,), poisson, length) == pytest.approx(exact, rel=0.005)


@pytest.mark.parametrize("aspect", [10, 50])
def test_flat_elements_in_a_bending_skin_stay_within_half_a_percent(aspect: int) -> None:
    # A skin 100 times as stiff as what it lies on, two elements thick, bends in long waves. Measured 0.2 %.
    skin = (Layer(0.4, 100.0, 2), Layer(4.0, 1.0, 40))
    length = 0.2 * aspect
    k = 2 * np.pi / (40 * length)
    assert compliance(k, skin, 0.48, length) == pytest.approx(layers_compliance(k, skin, 0.48), rel=0.005)
