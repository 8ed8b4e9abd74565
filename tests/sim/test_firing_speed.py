"""The slowest press at which an afferent fires is that of its class: current and membrane, at constant speed."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from sim.nerve.firing_speed import LEAST_MM_S, MOST_MM_S, firing_speed_mm_s
from sim.nerve.models import BUILT_IN, spikes_of
from sim.nerve.skin import Signal, SkinUnderIndentor

DOI_MM, STEP_S = 0.5, 1e-4
SPEEDS = {  # class and sensitivity, lowest and highest speed (mm/s); the measure is that of the reference SED at 1 mm
    ("SA1", 100.0): (LEAST_MM_S, LEAST_MM_S),  # it follows strain, and fires in a hold however slowly that begins
    ("RA", 1.0): (1.0, 1.05),  # its current is the rate of the measure: 1, the rheobase, at 1 mm/s
    ("RA", 10.0): (0.1, 0.105),  # ten times as sensitive, at a tenth of the speed
    ("RA", 1e-6): (None, None),  # 1e6 mm/s, which no press reaches
    ("PC", 1e-3): (LEAST_MM_S, MOST_MM_S),  # it follows the onset of a press, so that the speed counts
    ("PC", 1e-9): (None, None),
}


def skin(model: str) -> SkinUnderIndentor:
    depths = np.linspace(0.05, DOI_MM, 10)
    there: Any = BUILT_IN[model]
    return SkinUnderIndentor.of_values(depths, there.measure({"sed": there.reference_sed * depths**2})[:, None])


def fires(model: str, sensitivity: float, speed_mm_s: float) -> bool:
    noisy: Any = BUILT_IN[model]
    quiet = replace(noisy, membrane=replace(noisy.membrane, noise=0.0))
    t_s: NDArray[np.float64] = np.arange(0, DOI_MM / speed_mm_s + 0.3, STEP_S)
    value = skin(model).value(np.minimum(speed_mm_s * t_s, DOI_MM)).T
    return len(spikes_of(quiet, Signal(STEP_S, value[None]), [sensitivity], [0])[0]) > 0


@pytest.mark.parametrize("case", SPEEDS, ids=str)
def test_an_afferent_fires_from_its_speed_on_and_not_below(case: tuple[str, float]) -> None:
    low, high = SPEEDS[case]
    found = firing_speed_mm_s(BUILT_IN[case[0]], case[1], skin(case[0]), DOI_MM)
    if low is None or high is None:
        assert found is None
        assert not fires(*case, MOST_MM_S)
        return
    assert found is not None
    assert low <= found <= high
    assert fires(*case, found)
    assert found == LEAST_MM_S or not fires(*case, 0.95 * found)  # the search ends within 3 %
